"""The hanging strip at rest against closed forms and an independent solver."""

import numpy as np
import pytest

from drivers.strip.cantilever import SEGMENTS, NoRest, hanging_shape
from tests.support.elastica import heavy_elastica


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
    expected = heavy_elastica(hanging.arc, bending_length, curvature, clamp)
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
