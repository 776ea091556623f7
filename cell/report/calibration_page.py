"""HTML pages of a calibration and of its wizard's session: quality, and the plane in the image."""

from pathlib import Path
from typing import Any

import numpy as np

from calibration.calibration import Calibration, load_calibration
from calibration.wizard.session import PICTURE_FILE, VERDICT_FILE
from cell.record.files import CALIBRATION, REPORT
from cell.report.drawing import BLUE, INK, MUTED, as_svg, canvas
from cell.report.kit import jpeg_text, page
from cell.report.overlay import KeyPicture
from cell.report.verdict import Verdict
from cell.report.words import millimetres, milliseconds
from drivers.files import write_file
from drivers.readers import read_picture, read_yaml

# mm, the error of a measured curve (`sigma.profile`) that a calibration must not exceed
GOOD_RESIDUAL = 1.0
GRID_X, GRID_Z = np.arange(-0.1, 1.01, 0.1), np.arange(0.0, 0.51, 0.05)  # m
LINE_POINTS = 60  # points of a line, which a lens bends
SCALE_STEP = 1e-3  # m, over which the scale of the image is taken


def write_calibration_report(path: Path) -> Path:
    """Write the page of the calibration file at `path` beside it, and return its path.

    Raises ConfigurationError for a file that is no calibration, or a folder that cannot be written.
    """
    made = path.with_suffix(".html")
    text = calibration_report(load_calibration(path), path.name)
    write_file(made, text)
    return made


def write_session_page(folder: Path) -> Path:
    """Write the page of a wizard's session into its `folder`, and return its path.

    Raises ConfigurationError for a folder without a verdict, or one that cannot be written.
    """
    verdict, path = read_yaml(folder / VERDICT_FILE), folder / REPORT
    passed = bool(verdict.get("passed", verdict.get("accepted")))
    lines = [str(line) for line in verdict.get("lines", ())]
    made = folder / CALIBRATION
    said = Verdict("good" if passed else "bad", lines[-1] if lines else "Nothing was seen", ())
    text = _page(
        f"session {folder.name}",
        load_calibration(made) if made.is_file() else None,
        kicker="Session of a calibration wizard",
        name=folder.name,
        said=said,
        found=lines[:-1],
        pictures=_picture(folder),
    )
    write_file(path, text)
    return path


def _picture(folder: Path) -> list[KeyPicture]:
    """Picture of the session; none for one that was solved again."""
    path = folder / PICTURE_FILE
    if not path.is_file():
        return []
    said = "what was measured, in the last image"
    return [KeyPicture(jpeg_text(read_picture(path)), said, PICTURE_FILE)]


def calibration_report(calibration: Calibration, name: str) -> str:
    """HTML page of `calibration`, whose file is called `name`."""
    good = calibration.residual_mm <= GOOD_RESIDUAL and not calibration.accepted_anyway
    said = Verdict(
        "good" if good else "bad",
        "Touched points lie where the image shows them" if good else "Use it with care",
        (f"It was made on {calibration.date[:10]} and has the id {calibration.id}.",),
        f"{calibration.residual_mm:.2f} mm",
        "rms at points kept back",
    )
    return _page(
        f"calibration {calibration.id}",
        calibration,
        kicker="Calibration of a camera",
        name=name,
        said=said,
        refused=[f"The wizard refused it: {reason}" for reason in calibration.accepted_anyway],
    )


def _page(title: str, calibration: Calibration | None, **parts: Any) -> str:
    """HTML page with `parts` and the facts on a calibration, if there is one."""
    facts: dict[str, Any] = {"numbers": (), "grid": "", "locks": ()}
    if calibration is not None:
        locks = [(name, str(value)) for name, value in calibration.locks.items()]
        facts = {"numbers": _numbers(calibration), "grid": _plane_grid(calibration), "locks": locks}
    absent: dict[str, Any] = {"refused": (), "found": (), "pictures": ()}
    return page("report/templates/calibration.html", title, **absent | parts | facts)


def _numbers(calibration: Calibration) -> list[tuple[str, str]]:
    lens, middle = calibration.lens, np.array([[0.3, 0.1]])
    around = middle + SCALE_STEP * np.array([[0, 0], [1, 0], [0, 1]])
    pixels = calibration.to_image(around)
    along, above = np.linalg.norm(pixels[1:] - pixels[0], axis=1)
    patches = 0 if calibration.landmarks is None else len(calibration.landmarks.marks)
    return [
        ("camera from the strip's plane", millimetres(calibration.viewpoint.distance)),
        ("image", f"{lens.width} × {lens.height} px"),
        ("one pixel along the strip, at x 300, z 100 mm", millimetres(SCALE_STEP / along)),
        ("one pixel above the desk, there", millimetres(SCALE_STEP / above)),
        ("images are older than their stamps by", milliseconds(calibration.latency)),
        ("contact is seen too far by", millimetres(calibration.contact_bias, signed=True)),
        ("landmarks that reveal a moved camera", str(patches)),
    ]


def _plane_grid(calibration: Calibration) -> str:
    lens = calibration.lens
    with canvas(8.4, 8.4 * lens.height / lens.width) as figure:
        axes = figure.add_subplot(aspect="equal")
        for x in GRID_X:
            line = np.stack(
                [np.full(LINE_POINTS, x), np.linspace(GRID_Z[0], GRID_Z[-1], LINE_POINTS)], axis=1
            )
            axes.plot(*calibration.to_image(line).T, color=BLUE, lw=0.8, gid=f"x {1e3 * x:.0f} mm")
        for z in GRID_Z:
            line = np.stack(
                [np.linspace(GRID_X[0], GRID_X[-1], LINE_POINTS), np.full(LINE_POINTS, z)], axis=1
            )
            strong = {"color": INK, "lw": 1.6} if z == 0 else {"color": MUTED, "lw": 0.8}
            axes.plot(*calibration.to_image(line).T, **strong, gid=f"z {1e3 * z:.0f} mm")
        axes.plot(*calibration.to_image(np.zeros((1, 2))).T, "o", color=INK, ms=5)
        axes.set(
            xlim=(0, lens.width), ylim=(lens.height, 0), xlabel="column  [px]", ylabel="row  [px]"
        )
        axes.grid(False)
        return as_svg(figure)
