"""Messages of a wizard to its observers: terminal, Rerun, session folder."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Generic, TypeVar

from calibration.board import BoardView
from calibration.wizard.coverage import Gate, Sketch, WantedView
from calibration.wizard.latency import LatencySteps
from calibration.wizard.touches import Touched
from drivers.types import Array, Frame, Pose

Seen = TypeVar("Seen")
Taken = TypeVar("Taken")


@dataclass(frozen=True, slots=True)
class Result(Generic[Seen, Taken]):
    """Result of one image: its `number`, the measurement `seen`, the accepted one (`taken`) or the
    reason why it was `refused`; `waits` means that the next image decides.
    """

    number: int
    seen: Seen | None
    taken: Taken | None
    refused: str | None
    waits: bool = False

    def text(self, kind: str, taken: str) -> str:
        """Text of the result for the operator; empty while the next image is awaited."""
        if self.refused is None and self.waits:
            return ""
        return f"{kind} {self.number}: {self.refused or taken}"


ViewResult = Result[BoardView, BoardView]
TouchResult = Result[Array, Touched]  # seen: the disc's centre (2,) [px]


@dataclass(frozen=True, slots=True)
class ViewNews:
    """Progress of the lens calibration: view `wanted` and `why`, coverage, last result, sketch."""

    wanted: WantedView | None
    why: str
    gates: tuple[Gate, ...]
    frame: Frame | None = None
    result: ViewResult | None = None
    sketch: Sketch | None = None

    @property
    def title(self) -> str:
        """Title of the calibration with a board."""
        return "the lens, from a board"

    @property
    def request(self) -> str:
        """Request to the operator: how to hold the board."""
        return "nothing: all is covered" if self.wanted is None else f"show the board {self.wanted}"

    @property
    def answer(self) -> str:
        """Text about the newest image; empty where there is nothing to say."""
        return "" if self.result is None else self.result.text("image", "taken")


class Stage(StrEnum):
    """Stages of the touch calibration, in order."""

    TOUCH = "touch"
    AGAIN = "touch again"
    LATENCY = "latency"
    REMEMBER = "remember"


@dataclass(frozen=True, slots=True)
class TouchNews:
    """Progress of the touch calibration: pose `wanted` of the `plan` and `why`, last result.

    `touches` are all points so far; `frame` and `pose` the newest image and the arm's pose;
    `dropped` the touch that the operator took back.
    """

    stage: Stage
    plan: tuple[Pose, ...]
    touches: tuple[Touched, ...]
    wanted: Pose | None
    why: str
    frame: Frame | None = None
    pose: Pose | None = None
    result: TouchResult | None = None
    steps: LatencySteps | None = None
    dropped: Touched | None = None

    @property
    def title(self) -> str:
        """Title of the calibration by touches."""
        return f"the map to the plane: {self.stage}"

    @property
    def request(self) -> str:
        """The arm's next move, for the operator."""
        return "nothing" if self.wanted is None else f"the arm goes to {_place(self.wanted)}"

    @property
    def answer(self) -> str:
        """Text about the newest image; empty where there is nothing to say."""
        again = " again" if self.stage is Stage.AGAIN else ""
        touched = "" if self.pose is None else f"touched{again} at {_place(self.pose)}"
        return "" if self.result is None else self.result.text("point", touched)


News = ViewNews | TouchNews
Watcher = Callable[[News], None]


def nobody(_: News) -> None:
    """An observer that ignores everything."""


def _place(pose: Pose) -> str:
    return f"x {1e3 * pose.x:.0f}, z {1e3 * pose.z:.0f} mm"
