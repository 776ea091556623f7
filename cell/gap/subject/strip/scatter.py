"""Quantities that differ from run to run in a laboratory, as unknowns of each run."""

from dataclasses import dataclass, replace

from cell.gap.subject.subject import Parameter
from drivers.strip.model import StripModel
from drivers.types import frozen

FARTHEST = 8.0  # times its usual spread, the bound of a quantity in any run


@dataclass(frozen=True, slots=True)
class RunEffect:
    """Quantity that differs from run to run, with its `usual` standard deviation in a laboratory.

    `step` is the change of its finite differences. `place` is the part and field of the model to
    which its value is added, as a share of the field where the unit is 1. `sentence` names it for
    a technician, `remedy` is what makes it smaller.
    """

    name: str
    sentence: str
    unit: str
    usual: float
    step: float
    place: str
    remedy: str
    common: bool = False

    @property
    def parameter(self) -> Parameter:
        """Unknown of one run for the engine, with the usual spread."""
        most = FARTHEST * self.usual
        spread = (0.0, -most, most, self.step, self.usual)
        return Parameter(self.name, self.unit, *spread, random=True, common=self.common)

    def apply(self, model: StripModel, value: float) -> StripModel:
        """`model` with the quantity at `value` instead of zero."""
        part, _, field = self.place.partition(".")
        before = getattr(model, part)
        known = getattr(before, field)
        new = frozen(known * (1.0 + value)) if self.unit == "1" else known + value
        return replace(model, **{part: replace(before, **{field: new})})


GRIPPER_REMEDY, AIR_REMEDY, RIG_REMEDY = (
    "a stop against which the strip's edge is laid, or a gripper with firmer fingers",
    "longer rests between runs, and a steady temperature and humidity",
    "a stiffer desk and mount, and one clock for arm and camera",
)
RUN_EFFECTS = (
    RunEffect("grip_x", "where along the desk the edge is grasped",
              "m", 3e-4, 3e-4, "rig.grip_x", GRIPPER_REMEDY, common=True),
    RunEffect("grip_z", "at what height the edge is grasped",
              "m", 3e-4, 3e-4, "rig.grip_z", GRIPPER_REMEDY, common=True),
    RunEffect("grip_pitch", "at what angle the edge is grasped",
              "rad", 0.005, 0.005, "rig.grip_tilt", GRIPPER_REMEDY),
    RunEffect("slack", "how much strip lies between edge and grip",
              "m", 3e-4, 3e-4, "mechanics.length", GRIPPER_REMEDY),
    RunEffect("damping", "the strip's damping",
              "1", 0.05, 0.05, "mechanics.viscosity", AIR_REMEDY, common=True),
    RunEffect("stiffness", "the strip's stiffness",
              "1", 0.005, 0.01, "mechanics.rigidity", AIR_REMEDY, common=True),
    RunEffect("desk_height", "the height of the desk",
              "m", 2e-4, 3e-4, "rig.desk_height", RIG_REMEDY),
    RunEffect("clock_start", "the start of the camera's clock",
              "s", 0.002, 0.003, "observation.camera_latency", RIG_REMEDY),
)  # fmt: skip
"""Spreads: grasping by two fingers 0.3 mm, damping 5 %, stiffness 0.5 % of a well kept bench."""

TARE = "a tare in the posture at rest right before the grasp"
ONE_MESSAGE = "force and place from one message of the arm"
FORCE_EFFECTS = (
    RunEffect("force_x", "what the tare left of the force along the desk",
              "N", 0.02, 0.0005, "observation.force_x", TARE, common=True),
    RunEffect("force_z", "what the tare left of the force upwards",
              "N", 0.02, 0.0005, "observation.force_z", TARE, common=True),
    RunEffect("force_delay", "how late the arm reports a force",
              "s", 0.005, 0.0005, "observation.force_delay", ONE_MESSAGE),
)  # fmt: skip
"""What runs that measure force differ by besides. Spreads: assumed, for an arm at its best."""

KNOWN_EFFECTS = (*RUN_EFFECTS, *FORCE_EFFECTS)

SLACK_EFFECTS = tuple(effect for effect in RUN_EFFECTS if effect.name == "slack")
"""What is allowed for where no runs can say more: planned runs, and sizes of hidden effects."""
