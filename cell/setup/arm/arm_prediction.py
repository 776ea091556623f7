"""Prediction of a fold by a Franka arm: joints, margins and clearance along the
path.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from drivers.base.errors import in_mm
from drivers.base.installation import Installation
from drivers.base.types import Array
from drivers.franka.limits import JointLimits
from drivers.franka.obstacles import desk_clearance
from drivers.franka.reach import Reach, densify, plan_reach
from drivers.franka.shapes import RISE, desk_end


@dataclass(frozen=True, slots=True)
class ArmPrediction:
    """Predicted motion of a Franka arm in a whole fold: what its joints do, and the
    least `clearance` [m] of the hand over the desk.
    """

    reach: Reach
    clearance: float
    limits: JointLimits

    @property
    def allowed(self) -> bool:
        """Whether the arm can follow the whole fold without touching the desk."""
        return self.reach.allowed and self.clearance > 0

    def line(self) -> dict[str, Any]:
        """Content of the JSON object on the arm, a part of what `cell fold --dry-run
        --json` prints.
        """
        reach = self.reach
        return {
            "reachable": self.allowed,
            "hand_turned": reach.turned,
            "joint_margin": round(reach.margin, 4),
            "narrowest_joint": reach.joint,
            "start_joints": [round(q, 4) for q in reach.start.tolist()],
            "clearance": (
                round(self.clearance, 4) if np.isfinite(self.clearance) else None
            ),
            "problems": [str(problem) for problem in reach.problems],
        }

    def text(self) -> str:
        """Text of the arm's predicted motion for the operator."""
        reach = self.reach
        if not reach.allowed:
            problems = "\n    ".join(str(problem) for problem in reach.problems)
            return f"the arm cannot follow it from this mounting:\n    {problems}"
        side = "turned by half a turn" if reach.turned else "as mounted"
        hand = f"the hand stays {in_mm(self.clearance)} clear of the desk"
        if self.clearance <= 0:
            hand = f"but the hand would run {in_mm(-self.clearance)} into the desk"
        return (
            "the arm can follow it, approach, lay and retreat included, the hand"
            f" {side}; joint {reach.joint} comes nearest to its end, {reach.margin:.2f}"
            f" rad\n  {hand}, which must end with the strip and stand {in_mm(RISE)}"
            " above what is beside it"
        )


def predict_arm(
    installation: Installation,
    limits: JointLimits,
    length: float,
    path: Array,
    speeds: Array,
) -> ArmPrediction:
    """Predict the motion of the arm's joints in a fold of a strip of `length` [m] along
    the gripper's `path`.

    `path` (n, 3) x, z [m], pitch [rad] at `speeds` (n,) [m/s] is as of `whole_path`,
    the limits of the `installation` are those of the arm, `limits` those of its joints.
    """
    desk = desk_end(installation, length)
    clearance = float(desk_clearance(densify(path, speeds)[0], desk).min())
    reach = plan_reach(installation, path, speeds, limits=limits)
    return ArmPrediction(reach, clearance, limits)
