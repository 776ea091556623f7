"""Verdict on a calibration in use, from a few points touched again."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibration.calibration import Calibration
from calibration.touch_settings import TouchSettings
from calibration.wizard.touch_fit import Touched

LEAST = 3  # points that decide
ANEW = "run `cell calibrate homography` again"


@dataclass(frozen=True, slots=True)
class CheckVerdict:
    """Distance of each touched point, by its number, from where the calibration shows it [mm].

    `median_mm` and `worst_mm` are NaN without points; `reasons` is empty when `passed`.
    """

    errors_mm: dict[int, float]
    median_mm: float
    worst_mm: float
    reasons: tuple[str, ...]

    @property
    def passed(self) -> bool:
        """Whether the calibration still holds."""
        return not self.reasons


def check_verdict(
    touches: Sequence[Touched], calibration: Calibration, settings: TouchSettings
) -> CheckVerdict:
    """The verdict on `calibration` from `touches` that it was not made of."""
    errors = {touched.number: _error_mm(touched, calibration) for touched in touches}
    values = np.array(list(errors.values()))
    median = float(np.median(values)) if len(values) else float("nan")
    worst = float(values.max()) if len(values) else float("nan")
    return CheckVerdict(errors, median, worst, tuple(_reasons(values, settings)))


def _error_mm(touched: Touched, calibration: Calibration) -> float:
    seen = calibration.to_plane(touched.pixel[None])[0]
    return 1e3 * float(np.hypot(*(seen - touched.place)))


def _reasons(values: np.typing.NDArray[np.float64], settings: TouchSettings) -> list[str]:
    if len(values) < LEAST:
        return [f"{len(values)} points were touched, at least {LEAST} must decide; touch more"]
    reasons = []
    if values.max() > settings.worst_mm:
        reasons.append(
            f"a point is {values.max():.2f} mm off, allowed {settings.worst_mm:.2f}: the camera or "
            f"the arm's base has moved, or the pointer is loose; {ANEW}"
        )
    if np.median(values) > settings.median_mm:
        reasons.append(
            f"half of the points are more than {np.median(values):.2f} mm off, allowed "
            f"{settings.median_mm:.2f}; {ANEW}"
        )
    return reasons
