"""The offset of the edges of a laid fold, told from its loop."""

from dataclasses import replace

import numpy as np
import pytest

from cell.perception.laid import TOP, Loop, edge_offset
from cell.perception.measurement import StripMeasurement

LENGTH, THICKNESS = 0.6, 0.001
ANGLE = np.linspace(-np.pi / 2, np.pi / 2, 60)
ARCH = np.column_stack([0.28 + 0.011 * np.cos(ANGLE), 0.01 + 0.01 * np.sin(ANGLE)])
SEEN = StripMeasurement(1.0, 7, 0.28, 1.0, ARCH, 1.0, (0.291, 0.01), np.nan, np.nan)


def test_loop_is_read_from_its_tip_its_top_and_where_it_leaves_the_desk() -> None:
    loop = Loop.seen_in(SEEN)
    assert loop is not None
    assert loop == pytest.approx((0.291, 0.02, 0.011), abs=1e-4)


def test_a_tip_farther_left_leaves_twice_as_much_for_the_upper_layer() -> None:
    loop = Loop(0.291, 0.02, 0.011)
    moved = loop._replace(tip_x=0.290)
    gained = edge_offset(LENGTH, THICKNESS, moved) - edge_offset(LENGTH, THICKNESS, loop)
    assert gained == pytest.approx(0.002)


def test_higher_loop_holds_more_strip() -> None:
    low, high = Loop(0.291, 0.015, 0.01), Loop(0.291, 0.025, 0.01)
    assert edge_offset(LENGTH, THICKNESS, high) < edge_offset(LENGTH, THICKNESS, low)


@pytest.mark.parametrize(
    "hidden",
    [
        {"contact_x": np.nan},
        {"tip": (np.nan, np.nan)},
        {"profile": np.empty((0, 2))},
        {"profile": ARCH[: TOP - 1]},
    ],
)
def test_loop_that_is_not_visible_is_none(hidden: dict[str, object]) -> None:
    assert Loop.seen_in(replace(SEEN, **hidden)) is None
