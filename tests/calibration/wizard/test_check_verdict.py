"""A calibration in use, judged by a few points that are touched again."""

from types import SimpleNamespace

import numpy as np
import pytest

from calibration.wizard.touch_verdict import check_verdict
from calibration.wizard.touches import TouchSettings

SETTINGS = TouchSettings()
STRAIGHT = SimpleNamespace(to_plane=lambda pixels: pixels)


def touched(*off_mm: float):
    """Points seen so far off along x."""
    return [
        SimpleNamespace(
            number=n,
            pixel=np.array([0.1 * n + 1e-3 * off, 0.1]),
            position=(0.1 * n, 0.1),
        )
        for n, off in enumerate(off_mm)
    ]


def test_points_where_they_were_confirm_the_calibration() -> None:
    verdict = check_verdict(touched(0.1, -0.2, 0.3, 0.1, 0.0), STRAIGHT, SETTINGS)
    assert verdict.passed
    assert verdict.worst_mm == pytest.approx(0.3)
    assert verdict.median_mm == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("off", "reason"),
    [
        ((0.1, 0.1, 0.1, 0.1, 1.2), "a point is 1.20 mm off"),
        ((0.7, 0.8, 0.7, 0.1, 0.1), "half of the points are more than 0.70 mm off"),
        ((0.45, 0.45, 0.45, 0.45, 5.0), "a point is 5.00 mm off"),
        (
            (0.7, 0.7, 0.8, 0.7, 0.7),
            "all points are seen 0.7 mm off in the same direction",
        ),
        ((0.1, 0.1), "2 points were touched"),
        ((), "0 points were touched"),
    ],
)
def test_points_that_are_off_or_too_few_refuse_it(
    off: tuple[float, ...], reason: str
) -> None:
    (found,) = check_verdict(touched(*off), STRAIGHT, SETTINGS).reasons
    assert found.startswith(reason)


def test_a_program_is_told_the_median_and_the_worst_error() -> None:
    facts = check_verdict(touched(0.1, 0.2, 0.9), STRAIGHT, SETTINGS).facts()
    assert facts["median_mm"] == pytest.approx(0.2)
    assert facts["worst_mm"] == pytest.approx(0.9)
