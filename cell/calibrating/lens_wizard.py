"""`cell calibrate camera`: takes views of the board, fits the lens to them, and keeps both."""

from collections.abc import Callable, Collection
from dataclasses import dataclass
from pathlib import Path

import cv2

from calibration.board import BoardView, find_board
from calibration.lens import write_camera_info, write_opencv
from calibration.wizard.board_views import BoardViews
from calibration.wizard.coverage import WantedView
from calibration.wizard.lens_verdict import LensVerdict, lens_lines, lens_verdict
from calibration.wizard.news import ViewNews, Watcher
from calibration.wizard.picture import views_picture
from calibration.wizard.session import (
    PICTURE_FILE,
    ROWS_FILE,
    SESSION_FILE,
    VERDICT_FILE,
    Row,
    Session,
    SessionFolder,
    make_folder,
    new_session,
    read_session,
    session_to_resume,
    taken_images,
    write_image,
    write_yaml,
)
from cell.config.cell import CellFile
from cell.devices.devices import Devices
from cell.orchestrator.interrupt import Interrupted
from cell.orchestrator.operator import Answer, Ask, Operator, Question
from drivers.errors import ConfigurationError, Fault
from drivers.readers import read_text
from drivers.types import Frame

PERIOD = 0.1  # s between images that are looked at
STALL_TIMEOUT = 2.0  # s without an image after which the camera counts as stalled
ROS, OPENCV = "camera_info.yaml", "opencv.yaml"

Source = Callable[[WantedView], Frame]


@dataclass(frozen=True, slots=True)
class LensSession:
    """Folder and verdict of a session with the board."""

    folder: Path
    verdict: LensVerdict


def calibrate_lens(
    settings: CellFile,
    devices: Devices,
    folder: Path,
    operator: Operator,
    watch: Watcher,
    length: float | None,
    interrupted: Callable[[], bool] = lambda: False,
) -> LensSession:
    """Ask for views of the board until they suffice, and keep session and lens in `folder`.

    A session that was interrupted there goes on. `length` [m] is the ruler's length of the board's
    squares; on the twin it is measured there, and a session that goes on knows it.
    Raises Interrupted, and Fault where the camera delivers nothing.
    """
    aids = devices.aids
    views = BoardViews(settings.boards, patient=aids is None)
    devices.camera.connect()
    try:
        source = aids.show_board if aids is not None else _live_images(devices)
        first = source(WantedView(0.5, 0.5, settings.boards.sizes[1]))
        if length is None and aids is not None:
            length = aids.measure_board()
        size = (first.image.shape[1], first.image.shape[0])
        facts = {"length": length, "boards": settings.boards}
        locks = dict(devices.camera_locks())
        session = new_session("camera", devices.camera_identity, size, locks, **facts)
        if (folder / SESSION_FILE).exists():
            session = session_to_resume(folder, session)
            length = session.length
        keep = SessionFolder(folder, session, watch)
        _restore_views(views, folder, session)
        _show_board(views, source, operator, keep, interrupted)
    finally:
        devices.camera.close()
    if length is not None:
        views.set_length(length)
    verdict = views.verdict()
    _keep_lens(folder, verdict, devices.camera_identity)
    newest = keep.newest.frame if keep.newest is not None else None
    drawn = views_picture((newest or first).image, views.views, verdict.per_view)
    write_image(folder / PICTURE_FILE, drawn)
    return LensSession(folder, verdict)


def lens_again(folder: Path, without: Collection[int], out: Path | None) -> LensVerdict:
    """Fit the lens of the session in `folder` again, `without` some images, into `out` if given.

    Boards are detected anew in the saved images. Raises ConfigurationError for broken files.
    """
    cv2.setNumThreads(1)  # in several threads the last digits differ from time to time
    session = read_session(folder, "camera")
    board = session.boards.board()
    detector = cv2.aruco.CharucoDetector(board)
    views: dict[int, BoardView] = {}
    for row, image in taken_images(folder, session, without):
        view = find_board(image, detector, board).view
        if view is None:
            raise ConfigurationError(
                f"{folder / str(row.image)}: shows no board; leave number {row.number} out"
            )
        views[row.number] = view
    verdict = lens_verdict(views, session.image, session.length, session.boards)
    if out is not None:
        make_folder(out)
        _keep_lens(out, verdict, session.camera)
    return verdict


def newest_lens(folder: Path, camera: str) -> Path:
    """Newest lens file of `camera` under `folder`; raises ConfigurationError without one."""
    for path in sorted(folder.glob(f"*/{ROS}"), reverse=True):
        if f"camera_name: {camera}\n" in read_text(path):
            return path
    raise ConfigurationError(
        f"--lens: {folder} holds no lens of camera {camera}; run `cell calibrate camera` first, "
        "or name a file of ROS or OpenCV"
    )


def _show_board(
    views: BoardViews,
    source: Source,
    operator: Operator,
    watch: SessionFolder,
    interrupted: Callable[[], bool],
) -> None:
    """Request views of the board one after the other until enough are accepted."""
    size, seen = watch.session.image, None
    while (wanted := views.ask()) is not None:
        _check(interrupted)
        missing = [gate for gate in views.gates() if not gate.passed]
        why = f"still missing: {missing[0]}" if missing else "all is covered; for good measure"
        news = ViewNews(wanted, why, views.gates(), sketch=views.sketch(size, seen))
        watch(news)
        answer = operator.answer(Question(Ask.VIEW, news.request))
        _check(interrupted)
        if answer is Answer.SKIP:
            views.skip()
            continue
        if answer is Answer.AGAIN:
            if (dropped := views.drop_last()) is not None:
                watch.add(Row(number=dropped, dropped=True))
            continue
        frame = source(wanted)
        result = views.tell(frame)
        if result.waits:  # the next image decides
            frame = source(wanted)
            result = views.tell(frame)
        seen = result.seen
        sketch = views.sketch(size, seen)
        watch(ViewNews(views.ask(), why, views.gates(), frame, result, sketch))


def _restore_views(views: BoardViews, folder: Path, session: Session) -> None:
    """Accept the views of an interrupted session; raises ConfigurationError without a board."""
    for row, image in taken_images(folder, session, ()):
        if views.restore(row.number, image) is None:
            raise ConfigurationError(
                f"--resume: {folder / str(row.image)}: shows no board; take its line out of "
                f"{ROWS_FILE}"
            )


def _check(interrupted: Callable[[], bool]) -> None:
    if interrupted():
        raise Interrupted("the calibration was interrupted")


def _keep_lens(folder: Path, verdict: LensVerdict, camera: str) -> None:
    """Write the verdict to `folder`, and the lens in ROS and OpenCV formats if it passed."""
    content = {
        "passed": verdict.passed,
        "lines": [line.text for line in lens_lines(verdict)],
        "rms_px": None if verdict.fit is None else verdict.fit.rms,
        "per_view_px": {str(number): rms for number, rms in verdict.per_view.items()},
    }
    write_yaml(folder / VERDICT_FILE, content)
    if verdict.fit is not None and verdict.passed:
        write_camera_info(verdict.fit.lens, camera, folder / ROS)
        write_opencv(verdict.fit.lens, folder / OPENCV)


def _live_images(devices: Devices) -> Source:
    """Source of live images, PERIOD apart, while a person holds the board."""
    newest = [-1.0]

    def look(_: WantedView) -> Frame:
        asked = devices.clock.now()
        while devices.clock.now() < asked + STALL_TIMEOUT:
            devices.clock.wait_until(devices.clock.now() + PERIOD)
            frame = devices.camera.read(newest[0], timeout=0.0)
            if frame is not None:
                newest[0] = frame.stamp
                return frame
        raise Fault(
            "camera_stalled", f"no image in {STALL_TIMEOUT:.0f} s; look at the camera's cable"
        )

    return look
