"""Messages of the calibration wizard to its observers, and marks that are drawn into
images.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import StrEnum

import cv2
import numpy as np
from pydantic import ConfigDict, Field

from calibration.wizard.coverage import Gate, Sketch
from calibration.wizard.latency import LatencySteps
from drivers.base.settings import Settings
from drivers.base.types import Array, Frame, Image


class SessionRow(Settings):
    """One line of told.jsonl: an accepted or refused image and the measurements in it.

    `corners` are [id, u, v] of the board, `centre` of the pointer; `pose` x, z, pitch
    of the arm. `dropped` takes the earlier row of the same number back, and of the same
    touch (`again`). `taken` says that the image is accepted and must be kept;
    afterwards `image` names its file.
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
    taken: bool = Field(False, exclude=True)

    @property
    def waits(self) -> bool:
        """Whether the image was neither accepted nor refused, so that the next image
        decides.
        """
        return not self.taken and self.refused is None

    @property
    def answer(self) -> str:
        """Text for the operator on whether the image was taken or why it was refused;
        empty where the next image decides.
        """
        if self.waits:
            return ""
        if self.pose is None:
            return f"image {self.number}: {self.refused or 'taken'}"
        again = " again" if self.again else ""
        done = f"touched{again} at {position_text(*self.pose[:2])}"
        return f"point {self.number}: {self.refused or done}"


def position_text(x: float, z: float) -> str:
    """Text on the position of the pointer with the coordinates `x` and `z` [m], in
    millimetres.
    """
    return f"x {1e3 * x:.0f}, z {1e3 * z:.0f} mm"


class MarkKind(StrEnum):
    """Kinds of measured points that are drawn into an image: fitted ones, ones kept out
    of the fit, and ones that lie far off.
    """

    FITTED = "fitted"
    HELD_OUT = "held out"
    WILD = "wild"


ENLARGED = 300.0  # scale of drawn errors
COLOURS_BGR = {
    MarkKind.FITTED: (80, 210, 110),
    MarkKind.HELD_OUT: (255, 170, 40),
    MarkKind.WILD: (60, 60, 235),
}
LEVELS_MM = (0.01, 0.015, 0.02, 0.03, 0.05, 0.07, 0.1, 0.2, 0.5, 1.0)
LEVEL_STEP = 8  # px from one place to the next at which a level is computed
LEVEL_BGR = (60, 220, 240)
LINE_TYPE = cv2.LINE_AA
FONT = cv2.FONT_HERSHEY_SIMPLEX


@dataclass(frozen=True, slots=True, eq=False)
class Mark:
    """Point that was measured at the position `pixel` [px] in an image, to be drawn
    there with its label.

    Its `error` (2,) [px] is the measured point minus the one that the calibration
    predicts.
    """

    pixel: Array
    kind: MarkKind = MarkKind.FITTED
    label: str = ""
    error: Array | None = None


@dataclass(frozen=True, slots=True)
class Progress:
    """Message from a calibration wizard to its observers: what it asks for, why it
    does, and the result of the newest image.

    `frame` is that image, `marks` are drawn into it; without one, `result` takes a
    measurement back. `coverage` and `sketch` show how a board is to be held, `plan` the
    poses x, z [m] of the pointer, each with its state as a character. `steps` is the
    arm's motion for the latency.
    """

    title: str
    request: str
    why: str
    frame: Frame | None = None
    result: SessionRow | None = None
    marks: tuple[Mark, ...] = ()
    coverage: tuple[Gate, ...] = ()
    sketch: Sketch | None = None
    plan: tuple[tuple[float, float, str], ...] = ()
    steps: LatencySteps | None = None


Observer = Callable[[Progress], None]


def ignore(_: Progress) -> None:
    """Observer of a calibration wizard that does nothing with its messages."""


def draw_picture(
    image: Image,
    marks: Iterable[Mark],
    deviation: Callable[[Array], Array] | None = None,
) -> Image:
    """Darkened copy of `image` in which `marks` are drawn, with their
    errors enlarged.

    Lines show how well a place is known by the `deviation` (k,) [m] at pixels (k, 2),
    if given.
    """
    drawn = np.asarray(image * 0.55, dtype=np.uint8)
    if deviation is not None:
        _draw_levels(drawn, deviation)
    for mark in marks:
        _draw_mark(drawn, mark)
    return drawn


def _draw_levels(drawn: Image, deviation: Callable[[Array], Array]) -> None:
    """Draw into the image `drawn` the lines within which positions are known to some
    fixed accuracies, by the function `deviation`, which gives it [m] for rows of
    pixels.
    """
    height, width = drawn.shape[:2]
    v, u = np.mgrid[0:height:LEVEL_STEP, 0:width:LEVEL_STEP]
    pixels = np.column_stack([u.ravel(), v.ravel()]).astype(np.float64)
    coarse = 1e3 * deviation(pixels).reshape(u.shape)
    fine = cv2.resize(coarse, (width, height))

    for level in LEVELS_MM:
        within = (fine <= level).astype(np.uint8)
        line = cv2.morphologyEx(within, cv2.MORPH_GRADIENT, np.ones((2, 2), np.uint8))
        rows, columns = np.nonzero(line)
        if len(rows) == 0:
            continue

        drawn[rows, columns] = LEVEL_BGR
        nearest = np.hypot(rows - height / 2, columns - width / 2).argmin()
        corner = (int(columns[nearest]) + 4, max(int(rows[nearest]), 18) - 4)
        cv2.putText(drawn, f"{level} mm", corner, FONT, 0.5, LEVEL_BGR, 1, LINE_TYPE)


def _draw_mark(drawn: Image, mark: Mark) -> None:
    """Draw `mark` into the image `drawn`: a dot or, where it has a label, a circle with
    its error and label, or a cross for a point that lies far off.
    """
    at = _pixel(mark.pixel)
    colour = COLOURS_BGR[mark.kind]
    if not mark.label:
        cv2.circle(drawn, at, 2, colour, -1, LINE_TYPE)
        return

    if mark.kind is MarkKind.WILD:
        cv2.drawMarker(drawn, at, colour, cv2.MARKER_TILTED_CROSS, 20, 2, LINE_TYPE)
    else:
        cv2.circle(drawn, at, 6, colour, 1, LINE_TYPE)

    if mark.error is not None:
        end = _pixel(mark.pixel + ENLARGED * mark.error)
        cv2.arrowedLine(drawn, at, end, colour, 2, LINE_TYPE, tipLength=0.25)

    cv2.putText(
        drawn, mark.label, (at[0] + 12, at[1] - 10), FONT, 0.5, colour, 1, LINE_TYPE
    )


def _pixel(point: Array) -> tuple[int, int]:
    return round(float(point[0])), round(float(point[1]))
