"""desk_contact is where the strip leaves the desk for the fold, whatever lies before it."""

import numpy as np
import pytest

from drivers.strip.describe import describe
from drivers.strip.file import StripFile
from drivers.strip.shape import desk_contact
from drivers.twin.chain.engine import Chain
from drivers.types import Array
from policies.path import triangular

HEIGHT = 0.001


def test_ripples_of_the_lying_strip_are_no_desk_contact() -> None:
    s = np.linspace(0.0, 0.6, 121)
    lying = np.clip((0.4 - s) / 0.4, 0, None)
    z = np.where(s < 0.4, 0.0015 * np.sin(40 * s) ** 2 * (lying > 0.2), 2.0 * (s - 0.4) ** 2)
    x = np.where(s < 0.4, s, 0.4 + 0.9 * (s - 0.4))
    contact = desk_contact(np.column_stack([x, z]), HEIGHT)
    assert contact == pytest.approx(0.4 + 0.9 * np.sqrt(HEIGHT / 2.0), abs=0.001)


def test_strip_that_lies_flat_has_its_contact_at_the_grasped_edge() -> None:
    points = np.column_stack([np.linspace(0, 0.6, 7), np.zeros(7)])
    assert desk_contact(points, HEIGHT) == pytest.approx(0.6)


def test_dip_behind_the_buckle_of_a_lift_is_no_desk_contact() -> None:
    s = np.linspace(0.0, 0.6, 121)
    buckle = 0.004 * np.sin(np.pi * np.clip((s - 0.5) / 0.08, 0, 1)) ** 2
    z = buckle + np.clip(s - 0.59, 0, None)
    contact = desk_contact(np.column_stack([s, z]), HEIGHT)
    assert contact == pytest.approx(0.5 + 0.08 / 6, abs=0.002)


def first_above(points: Array, height: float) -> float:
    """The contact as a search from the fixed end finds it."""
    return float(points[np.argmax(points[:, 1] > height), 0])


def test_contact_of_a_chain_with_ripples_is_beside_its_lifted_part() -> None:
    strip = StripFile(
        name="rough",
        length=0.6,
        width=0.05,
        areal_density=0.4,
        bending_length=0.017,
        retardation_time=0.03,
        effects={"bending_hysteresis": {"yield_curvature": 48.6}},
    )
    chain, path = Chain(80), triangular(0.6, 0.03)
    chain.reset([describe(strip)])
    for step in range(1, 400):
        seen = chain.step(path.poses(0.0005 * step)[None], 0.005)
    points = chain.shapes()[0].copy()
    tip = points[np.argmax(points[:, 0]), 0]
    assert 0 < tip - seen.contact_x[0] < 0.06
    ripples = 0.0008 * np.sin(2 * np.pi * points[:, 0] / 0.03) ** 2
    rippled = points + np.where(points[:, :1] < 0.2, [0.0, 1.0], 0.0) * 2 * ripples[:, None]
    assert first_above(rippled, HEIGHT) < 0.02
    assert desk_contact(rippled, HEIGHT) == pytest.approx(seen.contact_x[0])
