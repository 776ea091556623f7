"""Errors of measuring a strip: those that differ from run to run, and those that runs
share.
"""

from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cell.gap.subject.subject import Samples, ScatterSource
from drivers.base.settings import StudyResult
from drivers.base.types import Array, frozen
from drivers.strip.model import StripModel, with_field


@dataclass(frozen=True, slots=True, kw_only=True)
class RunEffect(ScatterSource):
    """Quantity of a strip or of the rig that differs from run to run, and the field of
    the strip's model that it changes.

    `place` is the part and field of the model to which its value is added, as a share
    of the field where the unit is 1.
    """

    place: str

    def apply(self, model: StripModel, value: float) -> StripModel:
        """Copy of `model` in which `value` is added to the field that this quantity
        changes, as a fraction of it where the unit is 1.
        """
        stated = attrgetter(self.place)(model)
        changed = frozen(stated * (1.0 + value)) if self.unit == "1" else stated + value
        return with_field(model, self.place, changed)


GRIPPER_REMEDY = (
    "a stop against which the strip's edge is laid, or a gripper with firmer fingers"
)
AIR_REMEDY = "longer rests between runs, and a steady temperature and humidity"
RIG_REMEDY = "a stiffer desk and mount, and one clock for arm and camera"
RUN_EFFECTS = (
    RunEffect("grip_x", "where along the desk the edge is grasped", GRIPPER_REMEDY,
              "m", 3e-4, 3e-4, place="rig.grip_x", common=True),
    RunEffect("grip_z", "at what height the edge is grasped", GRIPPER_REMEDY,
              "m", 3e-4, 3e-4, place="rig.grip_z", common=True),
    RunEffect("grip_pitch", "at what angle the edge is grasped", GRIPPER_REMEDY,
              "rad", 0.005, 0.005, place="rig.grip_tilt"),
    RunEffect("slack", "how much strip lies between edge and grip", GRIPPER_REMEDY,
              "m", 3e-4, 3e-4, place="mechanics.length"),
    RunEffect("damping", "the strip's damping", AIR_REMEDY,
              "1", 0.05, 0.05, place="mechanics.viscosity", common=True),
    RunEffect("stiffness", "the strip's stiffness", AIR_REMEDY,
              "1", 0.005, 0.01, place="mechanics.rigidity", common=True),
    RunEffect("desk_height", "the height of the desk", RIG_REMEDY,
              "m", 2e-4, 3e-4, place="rig.desk_height"),
    RunEffect("clock_start", "the start of the camera's clock", RIG_REMEDY,
              "s", 0.002, 0.003, place="observation.camera_latency"),
)  # fmt: skip
"""Spreads: grasping by two fingers 0.3 mm, damping 5 %, stiffness 0.5 % of a well kept
bench.
"""

TARE = "a tare in the posture at rest right before the grasp"
ONE_MESSAGE = "force and place from one message of the arm"
FORCE_EFFECTS = (
    RunEffect("force_x", "what the tare left of the force along the desk", TARE,
              "N", 0.02, 0.0005, place="observation.force_x", common=True),
    RunEffect("force_z", "what the tare left of the force upwards", TARE,
              "N", 0.02, 0.0005, place="observation.force_z", common=True),
    RunEffect("force_delay", "how late the arm reports a force", ONE_MESSAGE,
              "s", 0.005, 0.0005, place="observation.force_delay"),
)  # fmt: skip
"""What runs that measure force differ by besides. Spreads: assumed, for an arm at its
best.
"""

KNOWN_EFFECTS = (*RUN_EFFECTS, *FORCE_EFFECTS)

SLACK_EFFECTS = tuple(effect for effect in RUN_EFFECTS if effect.name == "slack")
"""What is allowed for where no runs can say more: planned runs, and sizes of hidden
effects.
"""


class CameraBias(StudyResult):
    """Standard deviations [m, s] of perception's mean error over half a run, by
    quantity.

    Written by `python -m tests.lab study perception`. `edge` is how far out the near
    edge is seen, which moves the whole profile; the other errors are independent, that
    of the profile adds to it.
    """

    FILE = Path(__file__).with_name("bias.yaml")

    edge: float
    profile: float
    contact_x: float
    touch_time: float
    touch_x: float
    displacement: float
    strips: int


class ModelError(StudyResult):
    """Relative standard deviation of fitted `damping` between simulation engines.

    Written by `python -m tests.lab study damping`.
    """

    FILE = Path(__file__).with_name("damping.yaml")

    damping: float
    strips: int


def common_errors(samples: Samples, past: NDArray[np.bool_]) -> dict[str, Array]:
    """Residuals [m or s], one for each sample, that one standard deviation of each
    systematic measurement error causes, by the error's name.

    `past` (n,) says whether the gripper is past the middle of the strip: there a lifted
    strip shows its near edge on the other side.
    """
    sizes = CameraBias.shipped()
    quantities = samples.quantity
    sides = np.where(quantities == "profile", np.where(past, 1.0, -1.0), 0.0)
    errors = {"near edge": frozen(sizes.edge * sides)}

    # samples of one group err alike
    halves = np.where(past, "past", "before")
    zones = [f"{zone} {half}" for zone, half in zip(samples.zone, halves, strict=True)]
    one_group = np.full(len(halves), "")
    groups_of = {
        "profile": np.array(zones),
        "contact_x": halves,
        "touch_time": one_group,
        "touch_x": one_group,
        "displacement": one_group,
    }
    for quantity, groups in groups_of.items():
        measured = quantities == quantity
        size = getattr(sizes, quantity)
        for group in dict.fromkeys(map(str, groups[measured])):
            members = measured & (groups == group)
            errors[f"{quantity} {group}".strip()] = frozen(np.where(members, size, 0.0))

    return errors
