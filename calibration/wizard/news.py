"""Messages of a wizard to its observers: the terminal, Rerun, and the session's folder."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

from pydantic import ConfigDict

from calibration.wizard.coverage import Gate, Sketch
from calibration.wizard.latency import LatencySteps
from drivers.settings import Settings
from drivers.types import Array, Frame


class Row(Settings):
    """One line of told.jsonl: an accepted or refused image and its measurements.

    `corners` are [id, u, v] of the board, `centre` of the pointer; `pose` x, z, pitch of the arm.
    `dropped` takes the earlier row of the same number back, and of the same touch (`again`).
    """

    model_config = ConfigDict(extra="allow")  # a program writes it

    number: int
    image: str | None = None
    refused: str | None = None
    corners: tuple[tuple[int, float, float], ...] = ()
    centre: tuple[float, float] | None = None
    pose: tuple[float, float, float] | None = None
    again: bool = False
    dropped: bool = False


@dataclass(frozen=True, slots=True)
class Result:
    """Result of one image: its `row` in the session's folder, and whether it was accepted."""

    row: Row
    taken: bool = False

    @property
    def refused(self) -> str | None:
        """Reason why the image was refused; None where it was not."""
        return self.row.refused

    @property
    def waits(self) -> bool:
        """Whether the next image decides."""
        return not self.taken and self.row.refused is None

    def text(self, kind: str, taken: str) -> str:
        """Text of the result for the operator; empty while the next image is awaited."""
        return "" if self.waits else f"{kind} {self.row.number}: {self.row.refused or taken}"


class MarkKind(StrEnum):
    """Kinds of points that are drawn into an image."""

    FITTED = "fitted"
    HELD_OUT = "held out"
    WILD = "wild"


@dataclass(frozen=True, slots=True, eq=False)
class Mark:
    """A measured point in the image, `pixel` (2,) [px], its label, and its `error` (2,) [px]."""

    pixel: Array
    kind: MarkKind = MarkKind.FITTED
    label: str = ""
    error: Array | None = None


class PlannedPoint(NamedTuple):
    """A pose of the plan, x, z [m], and its `state`, a character of the terminal's legend."""

    x: float
    z: float
    state: str


@dataclass(frozen=True, slots=True)
class News:
    """Progress of a wizard: what it requests, `why`, and what came of the newest image.

    `frame` is that image, `result` what it gave and `answer` this as a text; `marks` are drawn into
    it. `coverage` and `sketch` show how a board is to be held, `plan` which poses were touched.
    `taken_back` is the row of a measurement that the operator took back, `steps` the arm's motion
    that shows the latency.
    """

    title: str
    request: str
    why: str
    frame: Frame | None = None
    result: Result | None = None
    answer: str = ""
    marks: tuple[Mark, ...] = ()
    coverage: tuple[Gate, ...] = ()
    sketch: Sketch | None = None
    plan: tuple[PlannedPoint, ...] = ()
    taken_back: Row | None = None
    steps: LatencySteps | None = None


Watcher = Callable[[News], None]


def nobody(_: News) -> None:
    """An observer that ignores everything."""
