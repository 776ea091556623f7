"""What a wizard tells those who watch it: the terminal, Rerun, the session's folder."""

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
    """The board: which view is `wanted` and `why`, what was `told` last, what is covered."""

    wanted: WantedView | None
    why: str
    gates: tuple[Gate, ...]
    frame: Frame | None = None
    told: ToldView | None = None


class Stage(StrEnum):
    """What a wizard that touches is doing."""

    TOUCH = "touch"
    AGAIN = "touch again"
    LATENCY = "latency"
    REMEMBER = "remember"


@dataclass(frozen=True, slots=True)
class TouchNews:
    """The pointer: which pose of the `plan` is `wanted` and `why`, what was `told` last.

    `touches` are all points so far; `frame` and `pose` what was just seen and where the arm was.
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
    """Watches nothing."""
