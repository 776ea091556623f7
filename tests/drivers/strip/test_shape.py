"""Features of shapes whose contact, tip and gap are known, and the rod's touches."""

import math

import numpy as np
import pytest

from drivers.strip.rod.engine import Rod
from drivers.strip.shape import NO_GAP, desk_contact, fold_tip, layer_gap, layer_touch
from drivers.types import Array
from policies.path import Path, circular, triangular
from tests.support.rod_cases import for_all, paper_grid, steady

DT = 0.005
OPENING = 0.002  # m
RADIUS, LYING, BACK, SAG = 0.02, 0.3, 0.2, 0.025  # m
PATHS = {
    "triangular": triangular(0.6),
    "shifted": triangular(0.6, 0.045),
    "circular": circular(0.6),
}


def _fold() -> tuple[Array, Array]:
    """Strip that lies, turns by a half circle and comes back sagging; arc lengths of its nodes."""
    turn = np.linspace(0.0, np.pi, 400)[1:]
    bend = np.stack([LYING + RADIUS * np.sin(turn), RADIUS * (1 - np.cos(turn))], axis=1)
    back = np.linspace(0.0, BACK, 401)[1:]
    upper = 2 * RADIUS - SAG * np.sin(np.pi * back / BACK) ** 2
    flat = np.linspace(0.0, LYING, 300)
    points = np.concatenate(
        [np.stack([flat, 0 * flat], 1), bend, np.stack([LYING - back, upper], 1)]
    )
    return points, np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])


def test_features_of_a_fold_are_those_of_its_curve() -> None:
    points, arc = _fold()
    height = 0.001
    rise = LYING + math.sqrt(RADIUS**2 - (RADIUS - height) ** 2)
    assert desk_contact(points, height) == pytest.approx(rise, abs=1e-6)
    assert fold_tip(points) == pytest.approx((LYING + RADIUS, RADIUS), abs=1e-6)
    gap = layer_gap(points, arc, OPENING)
    assert gap is not None
    half = LYING + np.pi * RADIUS + (arc[-1] - LYING - np.pi * RADIUS) / 2
    assert gap == pytest.approx((2 * RADIUS - SAG, LYING - BACK / 2, half), abs=2e-5)


def test_no_gap_counts_before_a_fold_or_before_it_has_opened() -> None:
    points, arc = _fold()
    assert layer_gap(points, arc, 2 * RADIUS) is None
    assert layer_gap(points[:500], arc[:500], OPENING) is None


def test_hump_before_the_fold_is_no_contact_and_a_lying_strip_has_its_at_the_end() -> None:
    points, _ = _fold()
    humped = points.copy()
    humped[20:60, 1] = 0.005
    assert desk_contact(humped, 0.001) == desk_contact(points, 0.001)
    assert desk_contact(points[:300], 0.001) == LYING


def test_touch_is_where_the_gap_fell_to_its_limit() -> None:
    assert layer_touch((0.003, 0.1, 0.4), (0.0, 0.4, 0.1), 0.001) == pytest.approx(
        (2 / 3, 0.3, 0.2)
    )
    assert layer_touch(tuple(NO_GAP), (0.0, 0.4, 0.1), 0.001) == (1.0, 0.4, 0.1)


@pytest.mark.parametrize("path", PATHS.values(), ids=PATHS)
def test_touches_of_the_rod_are_those_of_its_shapes(path: Path) -> None:
    rod = Rod(60)
    models = paper_grid()[::3]
    rod.reset(models)
    shapes = rod.follow(for_all(steady(path, DT), len(models)), DT, every=1).shapes
    for i, touch in enumerate(rod.touch):
        assert touch is not None
        last = math.ceil(touch.time / DT)
        before, now = (
            layer_gap(shapes[k - 1, i], rod.arc()[i], OPENING) or NO_GAP for k in (last - 1, last)
        )
        share, x, s = layer_touch(tuple(before), tuple(now), 0.001)
        assert touch.time == pytest.approx((last - 1 + share) * DT, abs=1e-9)
        assert touch.displacement == pytest.approx(0.6 - s - x, abs=1e-9)
