"""Messages of a wizard to its observers: terminal, Rerun, session folder."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

from calibration.board_views import ToldView
from calibration.touched_points import ToldTouch
from calibration.wizard.coverage import Gate
from calibration.wizard.latency import LatencySteps
from calibration.wizard.touch_fit import Touched
from calibration.wizard.wanted_view import WantedView
from drivers.types import Frame, Pose


@dataclass(frozen=True, slots=True)
class ViewNews:
    """Progress with the board: which view is `wanted` and `why`, the result
    `told` last, the coverage.
    """

    wanted: WantedView | None
    why: str
    gates: tuple[Gate, ...]
    frame: Frame | None = None
    told: ToldView | None = None


class Stage(StrEnum):
    """Stages of a wizard that touches."""

    TOUCH = "touch"
    AGAIN = "touch again"
    LATENCY = "latency"
    REMEMBER = "remember"


@dataclass(frozen=True, slots=True)
class TouchNews:
    """Progress with the pointer: which pose of the `plan` is `wanted` and `why`, the result `told`
    last.

    `touches` are all points so far; `frame` and `pose` the newest image and the arm's pose.
    """

    stage: Stage
    plan: tuple[Pose, ...]
    touches: tuple[Touched, ...]
    wanted: Pose | None
    why: str
    frame: Frame | None = None
    pose: Pose | None = None
    told: ToldTouch | None = None
    steps: LatencySteps | None = None


Watcher = Callable[[ViewNews | TouchNews], None]


def nobody(_: ViewNews | TouchNews) -> None:
    """An observer that ignores everything."""
