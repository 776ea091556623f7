"""Recomputation of a kept calibration session, without a cell."""

from collections.abc import Collection
from pathlib import Path

import cv2

from calibration.calibration import Calibration
from calibration.landmarks import Landmarks
from calibration.wizard.lens_verdict import LensVerdict
from calibration.wizard.solve_again import SolvedTouches, solve_touches_again, solve_views_again
from cell.operations.homography_wizard import LANDMARKS, assembled, keep_verdict
from cell.operations.lens_wizard import keep_lens
from drivers.errors import CellError, ConfigurationError
from drivers.settings import load


def lens_again(folder: Path, without: Collection[int], out: Path | None) -> LensVerdict:
    """The lens of the session in `folder`, `without` some images; into `out` where given."""
    cv2.setNumThreads(1)  # in several threads the last digits differ from time to time
    session, verdict = solve_views_again(folder, without)
    if out is not None:
        _make(out)
        keep_lens(out, verdict, session.camera)
    return verdict


def homography_again(
    folder: Path,
    without: Collection[int],
    out: Path | None,
    speed: float,
    *,
    accept_anyway: bool = False,
) -> tuple[SolvedTouches, Calibration | None]:
    """Map and latency of the session in `folder`, and the calibration where it is accepted."""
    cv2.setNumThreads(1)
    solved = solve_touches_again(folder, without)
    marks = folder / LANDMARKS
    try:
        made = assembled(
            solved.lens,
            solved.touches,
            solved.latency,
            camera=solved.session.camera,
            locks=solved.session.locks,
            landmarks=load(marks, Landmarks) if marks.exists() else None,
            accept_anyway=accept_anyway,
        )
    except ConfigurationError:
        raise
    except CellError:
        made = None
    if out is not None:
        _make(out)
        keep_verdict(out, solved.touches, solved.latency, made, speed)
    return solved, made


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigurationError(f"--out: {folder}: cannot be made: {error.strerror}") from None
