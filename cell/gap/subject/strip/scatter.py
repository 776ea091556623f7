"""What differs from run to run in a laboratory for no reason that matters."""

from collections.abc import Callable
from dataclasses import dataclass, replace

from cell.gap.subject.subject import Parameter
from drivers.strip.model import Mechanics, StripModel
from drivers.types import frozen

FARTHEST = 8.0  # times its usual spread, what any run may have


@dataclass(frozen=True, slots=True)
class RunEffect:
    """A quantity that each run has anew: `usual` is the spread of an honest laboratory.

    `step` is the change by which responses are measured; `changed(model, value)` is the model of
    a run that has it. `sentence` names it for a technician, `remedy` is what makes it smaller.
    """

    name: str
    sentence: str
    unit: str
    usual: float
    step: float
    changed: Callable[[StripModel, float], StripModel]
    remedy: str
    common: bool = False

    @property
    def parameter(self) -> Parameter:
        """The unknown of one run, with its usual spread."""
        most = FARTHEST * self.usual
        return Parameter(
            self.name,
            self.unit,
            0.0,
            -most,
            most,
            self.step,
            self.usual,
            random=True,
            common=self.common,
        )


def _grip_x(model: StripModel, value: float) -> StripModel:
    return replace(model, rig=replace(model.rig, grip_x=model.rig.grip_x + value))


def _grip_z(model: StripModel, value: float) -> StripModel:
    return replace(model, rig=replace(model.rig, grip_z=model.rig.grip_z + value))


def _grip_pitch(model: StripModel, value: float) -> StripModel:
    return replace(model, rig=replace(model.rig, grip_tilt=model.rig.grip_tilt + value))


def _desk(model: StripModel, value: float) -> StripModel:
    return replace(model, rig=replace(model.rig, desk_height=model.rig.desk_height + value))


def _clock(model: StripModel, value: float) -> StripModel:
    seen = model.observation
    return replace(model, observation=replace(seen, camera_latency=seen.camera_latency + value))


def _slack(model: StripModel, value: float) -> StripModel:
    strip = model.mechanics
    return replace(model, mechanics=replace(strip, length=strip.length + value))


def _stiffness(model: StripModel, value: float) -> StripModel:
    strip: Mechanics = model.mechanics
    changed = replace(strip, rigidity=frozen(strip.rigidity * (1.0 + value)))
    return replace(model, mechanics=changed)


def _damping(model: StripModel, value: float) -> StripModel:
    strip: Mechanics = model.mechanics
    changed = replace(strip, viscosity=frozen(strip.viscosity * (1.0 + value)))
    return replace(model, mechanics=changed)


def _force_x(model: StripModel, value: float) -> StripModel:
    seen = model.observation
    return replace(model, observation=replace(seen, force_x=seen.force_x + value))


def _force_z(model: StripModel, value: float) -> StripModel:
    seen = model.observation
    return replace(model, observation=replace(seen, force_z=seen.force_z + value))


def _force_delay(model: StripModel, value: float) -> StripModel:
    seen = model.observation
    return replace(model, observation=replace(seen, force_delay=seen.force_delay + value))


GRIPPER, AIR, RIG = (
    "a stop against which the strip's edge is laid, or a gripper with firmer fingers",
    "longer rests between runs, and a steady temperature and humidity",
    "a stiffer desk and mount, and one clock for arm and camera",
)
RUN_EFFECTS = (
    RunEffect("grip_x", "where along the desk the edge is grasped", "m", 3e-4, 3e-4, _grip_x,
              GRIPPER, common=True),
    RunEffect("grip_z", "at what height the edge is grasped", "m", 3e-4, 3e-4, _grip_z, GRIPPER,
              common=True),
    RunEffect("grip_pitch", "at what angle the edge is grasped", "rad", 0.005, 0.005, _grip_pitch,
              GRIPPER),
    RunEffect("slack", "how much strip lies between edge and grip", "m", 3e-4, 3e-4, _slack,
              GRIPPER),
    RunEffect("damping", "the strip's damping", "1", 0.05, 0.05, _damping, AIR, common=True),
    RunEffect("stiffness", "the strip's stiffness", "1", 0.005, 0.01, _stiffness, AIR, common=True),
    RunEffect("desk_height", "the height of the desk", "m", 2e-4, 3e-4, _desk, RIG),
    RunEffect("clock_start", "the start of the camera's clock", "s", 0.002, 0.003, _clock, RIG),
)  # fmt: skip
"""Spreads: grasping by two fingers 0.3 mm, damping 5 %, stiffness 0.5 % of a well kept bench."""

TARE = "a tare in the posture at rest right before the grasp"
FORCE_EFFECTS = (
    RunEffect("force_x", "what the tare left of the force along the desk", "N", 0.02, 0.0005,
              _force_x, TARE, common=True),
    RunEffect("force_z", "what the tare left of the force upwards", "N", 0.02, 0.0005, _force_z,
              TARE, common=True),
    RunEffect("force_delay", "how late the arm reports a force", "s", 0.005, 0.0005, _force_delay,
              "force and place from one message of the arm"),
)  # fmt: skip
"""What runs that measure force differ by besides. Spreads: assumed, for an arm at its best."""

KNOWN_EFFECTS = (*RUN_EFFECTS, *FORCE_EFFECTS)

SLACK = tuple(effect for effect in RUN_EFFECTS if effect.name == "slack")
"""What is allowed for where no runs can tell more: planned runs, and sizes of hidden effects."""
