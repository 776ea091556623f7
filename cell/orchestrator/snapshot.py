"""What the cell knows at one tick, and what it may command."""

from dataclasses import dataclass

from calibration.perception.sight import SeenTouch, Sight
from cell.orchestrator.states import State
from drivers.types import ArmState, Frame, HandState, Pose, Velocity


@dataclass(frozen=True, slots=True)
class Senses:
    """One tick's knowledge; times in seconds of the cell's clock.

    `frame` is the newest image, `fresh` whether it arrived on this tick; `identical` counts the
    images in a row that equal each other byte for byte; `doubtful_since` is when confidence fell
    below its limit, None while it is good; `touch` the layer_touch once
    it is seen; `entered` is when the state was entered.
    """

    time: float
    state: State
    entered: float
    arm: ArmState
    hand: HandState
    frame: Frame | None
    fresh: bool
    identical: int
    sight: Sight | None
    touch: SeenTouch | None
    doubtful_since: float | None


@dataclass(frozen=True, slots=True)
class MoveTo:
    """Move to rest at a pose; repeated while the arm moves there."""

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
