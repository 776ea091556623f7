"""Prediction of a fold by a Franka arm: joints, margins and clearance along the path."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from cell.config.cell import CellFile
from cell.devices.fold_path import whole_path
from drivers.arm.obstacles import RISE, desk_clearance, desk_end
from drivers.arm.reach import Reach, densify, plan_reach
from drivers.strip.file import StripFile
from drivers.types import Array

POINT_SPACING = 0.01  # m between points of the path that are kept


@dataclass(frozen=True, slots=True)
class ArmPrediction:
    """Predicted motion of a Franka arm in a whole fold; `clearance` [m] of hand over desk."""

    reach: Reach
    clearance: float

    @property
    def allowed(self) -> bool:
        """Whether the arm can follow the whole fold without touching the desk."""
        return self.reach.allowed and self.clearance > 0

    def line(self) -> dict[str, Any]:
        """JSON object of the arm's prediction, a part of `cell fold --dry-run --json`."""
        return {
            "reachable": self.allowed,
            "hand_turned": self.reach.turned,
            "joint_margin": round(self.reach.margin, 4),
            "narrowest_joint": self.reach.joint,
            "start_joints": [round(q, 4) for q in self.reach.start.tolist()],
            "clearance": round(self.clearance, 4) if np.isfinite(self.clearance) else None,
            "problems": [str(problem) for problem in self.reach.problems],
        }

    def text(self) -> str:
        """Text of the arm's predicted motion for the operator."""
        reach = self.reach
        if not reach.allowed:
            problems = "\n    ".join(str(problem) for problem in reach.problems)
            return f"the arm cannot follow it from this mounting:\n    {problems}"
        side = "turned by half a turn" if reach.turned else "as mounted"
        hand = f"the hand stays {1e3 * self.clearance:.0f} mm clear of the desk"
        if self.clearance <= 0:
            hand = f"but the hand would run {-1e3 * self.clearance:.0f} mm into the desk"
        return (
            f"the arm can follow it, approach, lay and retreat included, the hand {side}; joint "
            f"{reach.joint} comes nearest to its end, {reach.margin:.2f} rad\n"
            f"  {hand}, which must end with the strip and stand {1e3 * RISE:.0f} mm above what is "
            "beside it"
        )


def predict_arm(
    settings: CellFile, strip: StripFile, trace: Array, end: float | None
) -> ArmPrediction:
    """Predict the arm's motion for a strip carried along `trace` (k, 2) [m], laid at `end` [m]."""
    installation = settings.fci.limit(settings.installation)
    path, speeds = fold_poses(settings, strip, trace, end)
    desk = desk_end(installation, strip.length)
    clearance = float(desk_clearance(densify(path, speeds)[0], desk).min())
    return ArmPrediction(plan_reach(installation, path, speeds), clearance)


def fold_poses(
    settings: CellFile, strip: StripFile, trace: Array, end: float | None
) -> tuple[Array, Array]:
    """Poses (n, 3) [m, m, rad], speeds (n,) [m/s] of a fold with a strip carried along `trace`."""
    carry = _thin_out(np.concatenate([[(strip.length, 0.0)], trace]))
    installation = settings.fci.limit(settings.installation)
    return whole_path(strip.length, installation, settings.fold, carry, end)


def _thin_out(points: Array) -> Array:
    """Points (k, 2) [m] of a path, at least POINT_SPACING apart, and the path's last point."""
    kept = [points[0]]
    for point in points[1:]:
        if np.hypot(*(point - kept[-1])) >= POINT_SPACING:
            kept.append(point)
    return np.array([*kept, points[-1]])
