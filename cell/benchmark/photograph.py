"""A camera image of a fold by feedback, with the controller's measurements drawn in."""

from pathlib import Path

import numpy as np

from calibration.calibration import Calibration
from cell.benchmark.results import Results
from cell.record.frames import FrameNote, decode
from cell.record.run import Run, read_run
from cell.report.kit import jpeg_text
from cell.report.overlay import window_on
from drivers.errors import ConfigurationError
from drivers.types import Array, Image
from policies.path import circular, triangular

RED_BGR, GREEN_BGR, BLUE_BGR, BLACK_BGR = (40, 40, 220), (60, 190, 60), (230, 120, 30), (20, 20, 20)
PICTURE_WIDTH = 1000  # px
PART = 0.45  # of the fold's duration, about where the picture is taken
DOT_RADIUS = 9  # px
SUBPIXEL_BITS = 3  # of OpenCV's fixed-point coordinates
SUBPIXELS = 1 << SUBPIXEL_BITS  # in a pixel


def photograph(results: Results) -> str:
    """Annotated camera image (JPEG as text) of a fold by feedback; empty where none was kept.

    As in the paper: the line that is searched in red, the desk contact green, the gripper blue,
    triangle and circle black.
    """
    for fold in results.repeats("feedback") or results.folds("feedback"):
        try:
            return _photograph_of(read_run(Path(fold.run)))
        except ConfigurationError:
            continue
    return ""


def _photograph_of(run: Run) -> str:
    calibration, sights = run.calibration(), run.sights()
    notes = [n for n in run.frame_index() if n.file is not None and n.stamp > 0]
    if calibration is None or not notes or sights.stamp.size == 0:
        raise ConfigurationError(f"{run.folder}: keeps no images that could be shown")
    note = min(notes, key=lambda n: abs(n.stamp - PART * float(run.ticks.t[-1])))
    image = _draw_measurements(_image(note), run, note, calibration)
    return jpeg_text(window_on(run.ticks, calibration).of(image), PICTURE_WIDTH)


def _draw_measurements(image: Image, run: Run, note: FrameNote, calibration: Calibration) -> Image:
    ticks, sights = run.ticks, run.sights()
    length = float(ticks.x[0])
    drawn = image.copy()
    for path in (triangular(length), circular(length)):
        _draw_line(drawn, calibration, path.at(np.linspace(0.0, path.length, 200)), BLACK_BGR, 2)
    gripper = [np.interp(note.stamp, ticks.t, place) for place in (ticks.x, ticks.z)]
    _draw_line(drawn, calibration, np.array([(length, 0.0), (0.0, 0.0)]), RED_BGR, 2)
    row = int(np.argmin(np.abs(sights.stamp - note.stamp)))
    _draw_dot(drawn, calibration, np.array([sights.contact_x[row], 0.0]), GREEN_BGR)
    _draw_dot(drawn, calibration, np.array(gripper), BLUE_BGR)
    return drawn


def _image(note: FrameNote) -> Image:
    if note.file is None:
        raise ConfigurationError("the image was not kept")
    return decode(note.file)


def _draw_line(
    image: Image, calibration: Calibration, points: Array, bgr: tuple[int, int, int], width: int
) -> None:
    import cv2

    pixels = np.rint(SUBPIXELS * calibration.to_image(points)).astype(np.int32)
    cv2.polylines(image, [pixels], False, bgr, width, cv2.LINE_AA, shift=SUBPIXEL_BITS)


def _draw_dot(
    image: Image, calibration: Calibration, point: Array, bgr: tuple[int, int, int]
) -> None:
    import cv2

    if np.isfinite(point).all():
        place = np.rint(SUBPIXELS * calibration.to_image(point[None])[0]).astype(int)
        centre, radius = tuple(place.tolist()), SUBPIXELS * DOT_RADIUS
        cv2.circle(image, centre, radius, bgr, cv2.FILLED, cv2.LINE_AA, shift=SUBPIXEL_BITS)
