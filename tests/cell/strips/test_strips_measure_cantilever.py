"""The hanging strip at rest against closed forms and an independent solver."""

import numpy as np
import pytest
from scipy.integrate import solve_bvp

from drivers.strip.cantilever import SEGMENTS, HangingStrip, NoRest, hang, hinges
from drivers.types import Array


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
    hanging = hang(overhang, bending_length, rest_curvature=born, clamp_angle=clamp)
    expected = elastica(hanging, curvature, clamp)
    assert np.abs(hanging.points - expected).max() < 3e-6


def test_stiff_strip_sags_as_a_beam_does() -> None:
    """w L^4 / 8 EI = L^4 / 8 c^3."""
    hanging = hang(0.05, 0.2)
    assert hanging.points[-1, 1] == pytest.approx(-(0.05**4) / (8 * 0.2**3), rel=1e-3)


def test_soft_strip_hangs_beside_the_ledge_as_a_heavy_wire_does() -> None:
    """Under a long weight the bend is x = sqrt(2 EI / w L) wide."""
    hanging = hang(1.0, 0.02)
    assert hanging.points[-1, 0] == pytest.approx(np.sqrt(2 * 0.02**3 / 1.0), rel=0.02)


def test_textile_laboratory_reads_half_the_overhang_at_41_and_a_half_degrees() -> None:
    """Peirce's test: the chord falls by 41.5 degrees when the overhang is two bending lengths."""
    tip = hang(0.04, 0.02).points[-1]
    assert np.degrees(np.arctan2(-tip[1], tip[0])) == pytest.approx(41.5, abs=0.1)


def test_weightless_strip_keeps_the_curvature_it_was_born_with() -> None:
    hanging = hang(0.1, 10.0, rest_curvature=np.full(SEGMENTS, 8.0))
    circle = np.array([np.sin(0.8), 1 - np.cos(0.8)]) / 8.0
    np.testing.assert_allclose(hanging.points[-1], circle, atol=1e-6)


@pytest.mark.parametrize("curvature", [0.0, 12.0])
def test_motions_are_the_differences_of_shapes(curvature: float) -> None:
    arc = hinges(0.12)
    born = curvature * np.sin(40 * arc)

    def points(log: float, clamp: float, more: float) -> Array:
        length = 0.03 * float(np.exp(log))
        return hang(0.12, length, rest_curvature=born + more * arc, clamp_angle=clamp).points

    step = 1e-5
    here = hang(0.12, 0.03, rest_curvature=born)
    motions = [
        here.moved_by_bending_length(),
        here.moved_by_clamp_angle(),
        here.moved_by_rest_curvature(arc[:, None])[..., 0],
    ]
    for motion, change in zip(motions, np.eye(3) * step, strict=True):
        difference = (points(*change) - points(*-change)) / (2 * step)
        np.testing.assert_allclose(motion, difference, atol=1e-6 * np.abs(difference).max())


def test_strip_that_is_born_to_rise_stands_where_its_weight_leaves_it() -> None:
    """Curled up by half a turn: it rises, and still lies on the elastica."""
    hanging = hang(0.06, 0.05, rest_curvature=np.full(SEGMENTS, 30.0))
    assert hanging.points[-1, 1] > 0.01
    assert np.abs(hanging.points - elastica(hanging, 30.0, 0.0)).max() < 3e-6


def test_shape_that_cannot_be_found_is_an_error() -> None:
    born = np.random.default_rng(1).normal(0.0, 3e4, SEGMENTS)
    with pytest.raises(NoRest, match="no shape at rest"):
        hang(0.3, 0.02, rest_curvature=born)
