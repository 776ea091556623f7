"""Prediction of a fold by simulating the policy, and check of its path against the limits."""

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from calibration.calibration import load_calibration
from cell.arm.arm_prediction import ArmPrediction, predict_arm
from cell.arm.run_settings import at_speed
from cell.calibrate.calibration_in_use import check_current
from cell.config.cell import CellFile
from cell.devices.fold_path import whole_path
from cell.folding.feasibility import from_edge, path_problems, simulate
from cell.folding.request import Request
from drivers.errors import ConfigurationError
from drivers.types import Array
from policies.registry import make_policy
from policies.rollout import Folds


@dataclass(frozen=True, slots=True)
class Prediction:
    """Predicted fold: displacement [m] with bounds, None without a touch; path's range x, z [m]."""

    strip: str
    policy: str
    displacement: float | None
    low: float | None
    high: float | None
    reach: tuple[float, float, float, float]
    arm: ArmPrediction | None = None

    def line(self) -> dict[str, Any]:
        """JSON object of the prediction, as `cell fold --dry-run --json` prints it."""
        x_min, x_max, z_min, z_max = self.reach
        return {
            "strip": self.strip,
            "policy": self.policy,
            "displacement": self.displacement,
            "displacement_low": self.low,
            "displacement_high": self.high,
            "path": {"x": [x_min, x_max], "z": [z_min, z_max]},
            **({} if self.arm is None else {"arm": self.arm.line()}),
        }

    def __str__(self) -> str:
        """Text of the prediction for the operator."""
        x_min, x_max, z_min, z_max = (1e3 * value for value in self.reach)
        expected = "no touch"
        if self.displacement is not None:
            expected = f"displacement {1e3 * self.displacement:+.1f} mm"
        if self.low is not None and self.high is not None:
            expected += f", between {1e3 * self.low:+.1f} and {1e3 * self.high:+.1f} mm"
        return (
            f"{self.strip} by {self.policy}: expected {expected} over what is unknown of the "
            "strip\n"
            f"  the gripper stays within x {x_min:.0f} to {x_max:.0f} mm, z {z_min:.0f} to "
            f"{z_max:.0f} mm: inside its limits; nothing was moved"
            + ("" if self.arm is None else f"\n  {self.arm.text()}")
        )

    __repr__ = __str__


def predict(request: Request) -> Prediction:
    """Predict the fold of `request`; raises ConfigurationError for a path beyond its limits.

    The calibration that the cell file names is checked as a fold does.
    """
    settings = request.settings
    strip = request.strip
    if settings.calibration is not None:
        calibration = load_calibration(Path(settings.calibration))
        on_twin = not settings.camera_driver.real
        check_current(calibration, settings.calibration_days, datetime.now(UTC), on_twin=on_twin)

    def carry_at(speed: float) -> Array:
        slower = simulate_policy(request, at_speed(settings, speed))
        return from_edge(strip, slower.trace[:, 0])

    folds = simulate_policy(request, settings)
    places = folds.trace.reshape(-1, 2)
    carry = from_edge(strip, folds.trace[:, 0])
    problems = list(path_problems(places, carry, settings, carry_at))
    if problems:
        raise ConfigurationError("\n".join(problems))
    x_min, z_min = places.min(axis=0).tolist()
    x_max, z_max = places.max(axis=0).tolist()
    nominal = folds.displacement[0]
    spread = folds.displacement[folds.touched]
    arm = None
    if settings.arm_driver.is_franka:
        place = settings.installation
        path, speeds = whole_path(strip.length, place, settings.fold, carry, folds.touch[0])
        arm = predict_arm(place, strip.length, path, speeds)
    return Prediction(
        strip=strip.name,
        policy=request.policy,
        displacement=float(nominal) if np.isfinite(nominal) else None,
        low=float(spread.min()) if spread.size else None,
        high=float(spread.max()) if spread.size else None,
        reach=(x_min, x_max, z_min, z_max),
        arm=arm,
    )


def simulate_policy(request: Request, settings: CellFile) -> Folds:
    """Simulated folds by the policy of `request`, of its strip and corner strips, by `settings`.

    A bias of images or of the cell is in neither the simulation nor the policy made for it.
    """
    policy = make_policy(request.policy, request.checkpoint, in_rod=True)
    return simulate(settings, request.strip, policy, request.trial.seed)
