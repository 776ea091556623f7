"""The hanging strip at rest against closed forms and an independent solver."""

import numpy as np
import pytest
from scipy.integrate import solve_bvp

from drivers.base.types import Array
from drivers.strip.cantilever import SEGMENTS, HangingStrip, NoRest, hanging_shape


def elastica(hanging: HangingStrip, curvature: float, clamp: float) -> Array:
    """Points at the nodes by collocation of EI theta'' = w (L - s) cos(theta)."""
    c, length = hanging.bending_length, hanging.arc[-1]

    def slope(s: Array, y: Array) -> Array:
        bend = (length - s) * np.cos(y[0]) / c**3
        return np.array([y[1], bend, np.cos(y[0]), np.sin(y[0])])

    def ends(a: Array, b: Array) -> Array:
        return np.array([a[0] - clamp, b[1] - curvature, a[2], a[3]])

    s = hanging.arc
    angles = np.interp(s, 0.5 * (s[1:] + s[:-1]), hanging.angles)
    start = np.stack([angles, np.gradient(angles, s), *hanging.points.T])
    found = solve_bvp(slope, ends, s, start, tol=1e-8, max_nodes=100_000)
    assert found.success
    return np.array(found.sol(s)[2:].T)


@pytest.mark.parametrize(
    ("overhang", "bending_length", "curvature", "clamp"),
    [
        (0.05, 0.06, 0.0, 0.0),
        (0.10, 0.06, 0.0, 0.0),
        (0.10, 0.02, 0.0, 0.0),
        (0.25, 0.02, 0.0, 0.0),
        (0.25, 0.01, 0.0, 0.0),
        (0.15, 0.02, 20.0, 0.0),
        (0.15, 0.02, -10.0, 0.1),
    ],
)
def test_hanging_strip_lies_on_the_heavy_elastica(
    overhang: float, bending_length: float, curvature: float, clamp: float
) -> None:
    born = np.full(SEGMENTS, curvature)
    hanging = hanging_shape(
        overhang, bending_length, rest_curvature=born, clamp_angle=clamp
    )
    expected = elastica(hanging, curvature, clamp)
    assert np.abs(hanging.points - expected).max() < 3e-6


def test_textile_laboratory_reads_half_the_overhang_at_41_and_a_half_degrees() -> None:
    """Peirce's test: the chord falls by 41.5 degrees when the overhang is two bending
    lengths.
    """
    tip = hanging_shape(0.04, 0.02).points[-1]
    assert np.degrees(np.arctan2(-tip[1], tip[0])) == pytest.approx(41.5, abs=0.1)


@pytest.mark.parametrize(("overhang", "born"), [(0.3, 3e4), (0.0, 0.0), (-0.1, 0.0)])
def test_shape_that_cannot_be_found_is_an_error(overhang: float, born: float) -> None:
    curvature = np.random.default_rng(1).normal(0.0, born, SEGMENTS)
    with pytest.raises(NoRest, match="no shape at rest"):
        hanging_shape(overhang, 0.02, rest_curvature=curvature)
