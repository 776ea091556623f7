"""Overview picture of a session: measured points and their errors drawn over one image."""

from collections.abc import Iterable, Sequence

import cv2
import numpy as np

from calibration.wizard.news import Mark, MarkKind
from drivers.types import Array, Image

ENLARGED = 300.0  # scale of drawn errors
COLOURS_BGR = {
    MarkKind.FITTED: (80, 210, 110),
    MarkKind.HELD_OUT: (255, 170, 40),
    MarkKind.WILD: (60, 60, 235),
}
WHITE_BGR = (255, 255, 255)
LINE_TYPE = cv2.LINE_AA
FONT = cv2.FONT_HERSHEY_SIMPLEX


def draw_picture(image: Image, marks: Iterable[Mark], lines: Sequence[str]) -> Image:
    """`image` (h, w, 3), darkened, with `marks`, their errors `ENLARGED` times, and title lines."""
    drawn = np.asarray(image * 0.55, dtype=np.uint8)
    for mark in marks:
        _draw_mark(drawn, mark)
    for k, line in enumerate(lines):
        cv2.putText(drawn, line, (18, 30 + 26 * k), FONT, 0.62, WHITE_BGR, 1, LINE_TYPE)
    return drawn


def _draw_mark(drawn: Image, mark: Mark) -> None:
    """Draw a dot, or for a point with a label a circle, its error and its label; wild: a cross."""
    at, colour = _pixel(mark.pixel), COLOURS_BGR[mark.kind]
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
    cv2.putText(drawn, mark.label, (at[0] + 12, at[1] - 10), FONT, 0.5, colour, 1, LINE_TYPE)


def _pixel(point: Array) -> tuple[int, int]:
    return round(float(point[0])), round(float(point[1]))
