"""Recomputation of a saved session from its images, with chosen ones left out."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from calibration.board_view import BoardView, find_board
from calibration.lens import Lens
from calibration.pointer import find_pointer
from calibration.touched_points import held_out
from calibration.wizard.latency import LatencyVerdict, SeenStep, latency_verdict
from calibration.wizard.lens_verdict import LensVerdict, lens_verdict
from calibration.wizard.session import Session, read_image, read_latency, read_rows, read_session
from calibration.wizard.touch_fit import Touched
from calibration.wizard.touch_verdict import TouchVerdict, touch_verdict
from drivers.errors import ConfigurationError

NONE: Collection[int] = ()


@dataclass(frozen=True, slots=True)
class SolvedTouches:
    """A session of touches, its lens, and the recomputed result."""

    session: Session
    lens: Lens
    touches: TouchVerdict
    latency: LatencyVerdict | None


def solve_views_again(folder: Path, without: Collection[int] = NONE) -> tuple[Session, LensVerdict]:
    """The lens from the session in `folder`, `without` the images of these numbers.

    Boards are detected anew in the saved images. Raises ConfigurationError for broken files.
    """
    session = read_session(folder, "camera")
    board = session.boards.board()
    detector = cv2.aruco.CharucoDetector(board)
    views: dict[int, BoardView] = {}
    for row in read_rows(folder):
        if row.taken and row.number not in without:
            view = find_board(read_image(folder, row, session.image), detector, board).view
            if view is None:
                raise ConfigurationError(
                    f"{folder / str(row.image)}: shows no board; leave number {row.number} out"
                )
            views[row.number] = view
    return session, lens_verdict(views, session.image, session.length, session.boards)


def solve_touches_again(folder: Path, without: Collection[int] = NONE) -> SolvedTouches:
    """The map and the latency from the session in `folder`, `without` the points so numbered.

    The pointer is detected anew in the saved images. Raises ConfigurationError for broken files or
    a session without a lens.
    """
    session = read_session(folder, "homography")
    if session.lens is None:
        raise ConfigurationError(f"{folder}: session.yaml: lens: is missing; add it")
    lens = session.lens.lens(f"{folder}: lens")
    touches = [*_touches(folder, session, without).values()]
    verdict = touch_verdict(touches, lens, session.touches)
    steps = read_latency(folder)
    latency = None
    if len(steps["arm"]) and verdict.homography is not None:
        seen = [SeenStep(float(t), np.array([u, v])) for t, u, v in steps["seen"]]
        latency = latency_verdict(steps["arm"], seen, lens, verdict.homography, session.latency)
    return SolvedTouches(session, lens, verdict, latency)


def _touches(
    folder: Path, session: Session, without: Collection[int]
) -> Mapping[tuple[int, bool], Touched]:
    """Accepted points by number and whether they are a second touch; the last of each counts."""
    touches: dict[tuple[int, bool], Touched] = {}
    for row in read_rows(folder):
        if not row.taken or row.number in without:
            continue
        if row.pose is None:
            raise ConfigurationError(f"{folder}: point {row.number} has no pose; leave it out")
        centre = find_pointer(read_image(folder, row, session.image))
        if centre is None:
            raise ConfigurationError(
                f"{folder / str(row.image)}: shows no pointer; leave number {row.number} out"
            )
        touches[row.number, row.again] = Touched(
            row.number,
            np.array(row.pose[:2]),
            centre,
            held_out(row.number, session.touches),
            again=row.again,
        )
    return touches
