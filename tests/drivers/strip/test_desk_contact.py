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
