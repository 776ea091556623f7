"""State of the cell at one tick of the control loop, and the commands to arm and
hand.
"""

from dataclasses import dataclass

from cell.orchestrator.states import State
from cell.orchestrator.vision import View
from drivers.base.types import ZERO_VELOCITY, ArmState, HandState, Pose, Velocity
from policies.policy import FoldPrediction


@dataclass(frozen=True, slots=True)
class Snapshot:
    """State of the cell at one tick of the control loop; times in seconds of the cell's
    clock.

    `entered` is when the state was entered, `velocity` the last commanded one,
    `predicted` the policy's newest prediction; `closed` is whether the hand was told to
    close.
    """

    time: float
    state: State
    entered: float
    arm: ArmState
    hand: HandState
    view: View
    velocity: Velocity = ZERO_VELOCITY
    predicted: FoldPrediction | None = None
    closed: bool = False


@dataclass(frozen=True, slots=True)
class MoveTo:
    """Command to the arm to move to rest at `pose`; repeated on every tick of the
    motion.
    """

    pose: Pose


@dataclass(frozen=True, slots=True)
class Drive:
    """Command to the arm to follow `velocity` [m/s, rad/s] until the next tick."""

    velocity: Velocity


@dataclass(frozen=True, slots=True)
class Hold:
    """Command to the arm to stay at rest, or to brake to rest."""


@dataclass(frozen=True, slots=True)
class OpenHand:
    """Command to the hand to open its fingers to `width` [m]; None opens them as wide
    as they go.
    """

    width: float | None = None


@dataclass(frozen=True, slots=True)
class CloseHand:
    """Command to the hand to close its fingers on the strip."""


Command = MoveTo | Drive | Hold | OpenHand | CloseHand
