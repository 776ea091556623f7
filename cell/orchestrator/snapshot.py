"""State of the cell at one tick, and the commands."""

from dataclasses import dataclass

from cell.orchestrator.states import State
from cell.orchestrator.vision import View
from drivers.types import ZERO_VELOCITY, ArmState, HandState, Pose, Velocity
from policies.prediction import FoldPrediction


@dataclass(frozen=True, slots=True)
class Snapshot:
    """State of the cell at one tick; times in seconds of the cell's clock.

    `entered` is when the state was entered, `velocity` the last commanded one, `predicted` the
    policy's newest prediction.
    """

    time: float
    state: State
    entered: float
    arm: ArmState
    hand: HandState
    view: View
    velocity: Velocity = ZERO_VELOCITY
    predicted: FoldPrediction | None = None


@dataclass(frozen=True, slots=True)
class MoveTo:
    """Move to rest at a pose; repeated on every tick of the move."""

    pose: Pose


@dataclass(frozen=True, slots=True)
class Drive:
    """Follow a velocity until the next tick."""

    velocity: Velocity


@dataclass(frozen=True, slots=True)
class Hold:
    """Stay at rest; brake if moving."""


@dataclass(frozen=True, slots=True)
class OpenHand:
    """Open the fingers."""


@dataclass(frozen=True, slots=True)
class CloseHand:
    """Close the fingers on the strip."""


Command = MoveTo | Drive | Hold | OpenHand | CloseHand
