"""Overview picture of a session: measured points and their errors drawn over one image."""

from collections.abc import Iterable, Mapping, Sequence

import cv2
import numpy as np

from calibration.board import BoardView
from calibration.homography import Homography
from calibration.lens import Lens
from calibration.wizard.touch_verdict import TouchVerdict
from calibration.wizard.touches import Touched
from drivers.types import Array, Image

ENLARGED = 300.0  # scale of drawn errors
FITTED_BGR, HELD_OUT_BGR = (80, 210, 110), (255, 170, 40)
BAD_BGR, WHITE_BGR = (60, 60, 235), (255, 255, 255)
LINE_TYPE = cv2.LINE_AA
FONT = cv2.FONT_HERSHEY_SIMPLEX


def views_picture(image: Image, views: Iterable[BoardView], per_view: Mapping[int, float]) -> Image:
    """`image` (h, w, 3) with every corner of all views drawn in, to show the coverage."""
    drawn = _darken(image)
    for view in views:
        for corner in view.image:
            cv2.circle(drawn, _pixel(corner), 2, FITTED_BGR, -1, LINE_TYPE)
    words = (
        f"{len(per_view)} views; corners off by up to {max(per_view.values(), default=0):.2f} px"
    )
    return _draw_title(drawn, (words,))


def touches_picture(
    image: Image, touches: Sequence[Touched], lens: Lens, verdict: TouchVerdict
) -> Image:
    """`image` (h, w, 3) with touched points, errors drawn `ENLARGED` times, outliers crossed."""
    drawn = _darken(image)
    off = {point.number for point in verdict.rejected}
    replaced = {point.number for point in verdict.wild}
    for touched in touches:
        at = _pixel(touched.pixel)
        if touched.number in off or (touched.number in replaced and not touched.again):
            colour = BAD_BGR
            cv2.drawMarker(drawn, at, BAD_BGR, cv2.MARKER_TILTED_CROSS, 20, 2, LINE_TYPE)
        else:
            colour = HELD_OUT_BGR if touched.held_out else FITTED_BGR
            cv2.circle(drawn, at, 6, colour, 1, LINE_TYPE)
            _draw_error(drawn, touched, lens, verdict.homography, colour)
        cv2.putText(
            drawn, str(touched.number), (at[0] + 12, at[1] - 10), FONT, 0.5, colour, 1, LINE_TYPE
        )
    words = (
        f"green: fitted, blue: held out, red: wild; errors drawn {ENLARGED:.0f} times",
        f"held out: {verdict.residual_mm:.2f} mm rms, {verdict.worst_mm:.2f} mm at worst; "
        f"halves agree within {verdict.halves_mm:.2f} mm",
    )
    return _draw_title(drawn, words)


def _draw_error(
    drawn: Image,
    touched: Touched,
    lens: Lens,
    homography: Homography | None,
    colour: tuple[int, int, int],
) -> None:
    if homography is None:
        return
    mapped = lens.distort(homography.to_image(touched.place))[0]
    end = touched.pixel + ENLARGED * (touched.pixel - mapped)
    cv2.arrowedLine(drawn, _pixel(touched.pixel), _pixel(end), colour, 2, LINE_TYPE, tipLength=0.25)


def _draw_title(drawn: Image, lines: Sequence[str]) -> Image:
    for k, line in enumerate(lines):
        cv2.putText(drawn, line, (18, 30 + 26 * k), FONT, 0.62, WHITE_BGR, 1, LINE_TYPE)
    return drawn


def _darken(image: Image) -> Image:
    return np.asarray(image * 0.55, dtype=np.uint8)


def _pixel(point: Array) -> tuple[int, int]:
    return round(float(point[0])), round(float(point[1]))
