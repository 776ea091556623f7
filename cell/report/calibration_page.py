"""HTML pages of a calibration and of a wizard's session: its error, the plane drawn in
an image.
"""

from pathlib import Path
from typing import Any

import cv2
import numpy as np

from calibration.calibration import Calibration, load_calibration
from calibration.wizard.progress import ENLARGED
from calibration.wizard.session import PICTURE_FILE, POSES_FILE, VERDICT_FILE
from cell.record.files import CALIBRATION, REPORT
from cell.report.html import Card, jpeg_text, page
from cell.report.overlay import KeyPicture
from cell.report.words import millimetres, milliseconds
from drivers.base.files import write_file
from drivers.base.outputs import write_output
from drivers.base.readers import read_picture, read_yaml
from drivers.base.types import Array, Image

# mm, the error of a measured curve (`sigma.profile`) that a calibration must not exceed
GOOD_RESIDUAL = 1.0
GRID_X, GRID_Z = np.arange(-0.1, 1.01, 0.1), np.arange(0.0, 0.51, 0.05)  # m
LINE_POINTS = 60  # points of a line, which a lens bends
WHITE = (255, 255, 255)  # BGR
BESIDE_X, BESIDE_Z = (4, -4), (-56, -4)  # px from a line's start to its label
LEGEND = (
    "green: fitted; blue: kept back, to judge by; red cross: does not fit the others;"
    f" arrows are errors, {ENLARGED:.0f} times as long;"
    " yellow: a place is known to so many mm by the points"
)
FRACTION = 4  # bits of a pixel to which lines are drawn
PICTURE_WIDTH = 1280  # px
SCALE_STEP = 1e-3  # m, over which the scale of the image is taken


def write_calibration_report(path: Path) -> Path:
    """Write the page of the calibration file at `path` beside it; ConfigurationError if
    none.
    """
    calibration = load_calibration(path)
    good = calibration.residual_mm <= GOOD_RESIDUAL and not calibration.accepted_anyway
    said = Card(
        "good" if good else "bad",
        "Touched points lie where the image shows them" if good else "Use it with care",
        (f"It was made on {calibration.date[:10]} and has the id {calibration.id}.",),
        f"{calibration.residual_mm:.2f} mm",
        "rms at touched points that were not fitted",
    )
    text = _page(
        path.parent,
        f"calibration {calibration.id}",
        calibration,
        kicker="Calibration of a camera",
        name=path.name,
        said=said,
        refused=[
            f"The wizard refused it: {reason}" for reason in calibration.accepted_anyway
        ],
    )
    out = path.with_suffix(".html")
    write_output(out, text)
    return out


def write_session_page(folder: Path) -> Path:
    """Write the HTML page of a wizard's session into its `folder`; returns the page's
    path.

    Raises ConfigurationError for a folder without a verdict, or one that cannot be
    written.
    """
    verdict = read_yaml(folder / VERDICT_FILE)
    passed = bool(verdict.get("passed", verdict.get("accepted")))
    lines = [str(line) for line in verdict.get("lines", ())]
    made = folder / CALIBRATION
    said = Card(
        "good" if passed else "bad", lines[-1] if lines else "Nothing was seen", ()
    )
    text = _page(
        folder,
        f"session {folder.name}",
        load_calibration(made) if made.is_file() else None,
        kicker="Session of a calibration wizard",
        name=folder.name,
        said=said,
        found=lines[:-1],
    )
    write_file(folder / REPORT, text)
    return folder / REPORT


def _pictures(folder: Path, calibration: Calibration | None) -> list[KeyPicture]:
    """Image of the session or run in `folder`, the strip's plane drawn in; empty
    without one.
    """
    images = (folder / PICTURE_FILE, *sorted(folder.glob("frames/*.png")))
    path = next(filter(Path.is_file, images), None)
    if path is None:
        return []
    image = read_picture(path)
    if calibration is not None:
        _draw_plane(image, calibration)
    where = str(path.relative_to(folder))
    caption = f"{where}; the touched points are on the page of the session"
    if calibration is None:
        caption = "a green dot: a corner of the board, of all views that were taken"
    if (folder / POSES_FILE).is_file():
        caption = LEGEND
    return [KeyPicture(jpeg_text(image, PICTURE_WIDTH), caption, where)]


def _page(
    folder: Path, title: str, calibration: Calibration | None, **parts: Any
) -> str:
    """Page on `calibration`, if any, with the pictures of its `folder` and `parts`."""
    facts: dict[str, Any] = {"numbers": (), "locks": (), "refused": (), "found": ()}
    if calibration is not None:
        facts["numbers"] = _numbers(calibration)
        facts["locks"] = calibration.locks.items()
    facts["pictures"] = _pictures(folder, calibration)
    return page("report/templates/calibration.html", title, **facts | parts)


def _numbers(calibration: Calibration) -> list[tuple[str, str]]:
    """Table rows (quantity, value) on a calibration."""
    lens = calibration.lens
    pixels = calibration.to_image((0.3, 0.1) + SCALE_STEP * np.array([[0, 0], [1, 0]]))
    along = float(np.linalg.norm(pixels[1] - pixels[0]))
    return [
        ("camera from the strip's plane", millimetres(calibration.viewpoint.distance)),
        ("image", f"{lens.width} × {lens.height} px"),
        ("one pixel, at x 300, z 100 mm", millimetres(SCALE_STEP / along)),
        ("images are stamped late by", milliseconds(calibration.latency)),
        (
            "contact is seen too far by",
            millimetres(calibration.contact_bias, signed=True),
        ),
    ]


def _draw_plane(image: Image, calibration: Calibration) -> None:
    """Draw the plane of the strip into an `image` of the camera, as lines with their
    mm.
    """
    for line in (
        *(_line(x, GRID_Z) for x in GRID_X),
        *(_line(GRID_X, z) for z in GRID_Z),
    ):
        pixels = np.rint(2**FRACTION * calibration.to_image(line)).astype(np.int32)
        cv2.polylines(image, [pixels], False, WHITE, 1, cv2.LINE_AA, FRACTION)
    labels = [(f"x {1e3 * x:.0f}", x, 0.0, BESIDE_X) for x in GRID_X]
    labels += [(f"z {1e3 * z:.0f}", 0.0, z, BESIDE_Z) for z in GRID_Z[1:]]
    for text, x, z, beside in labels:
        origin = (
            np.rint(calibration.to_image(np.array([[x, z]]))[0]).astype(int) + beside
        )
        cv2.putText(
            image, text, origin.tolist(), cv2.FONT_HERSHEY_SIMPLEX, 0.5, WHITE, 1
        )


def _line(x: float | Array, z: float | Array) -> Array:
    """Points (LINE_POINTS, 2) x, z [m] of the strip's plane on a line between the
    extremes of `x` and `z` [m].
    """
    ends = [np.linspace(np.min(v), np.max(v), LINE_POINTS) for v in (x, z)]
    return np.stack(ends, axis=1)
