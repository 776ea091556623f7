"""`cell calibrate camera`: views of the board, the lens fitted from them, both kept."""

from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from calibration.board_views import BoardViews
from calibration.camera_info import write_camera_info, write_opencv
from calibration.wizard.lens_verdict import LensVerdict
from calibration.wizard.news import ViewNews, Watcher
from calibration.wizard.note import Note
from calibration.wizard.picture import views_picture
from calibration.wizard.session import (
    PICTURE,
    VERDICT,
    Session,
    SessionFolder,
    write_image,
    write_yaml,
)
from calibration.wizard.wanted_view import WantedView
from calibration.wizard.words import lens_lines
from cell.config.cell import CellFile
from cell.devices.devices import Devices
from cell.operations.interrupt import Interrupted
from cell.orchestrator.operator import Answer, Ask, Operator, Question
from drivers.errors import ConfigurationError, Fault
from drivers.types import Frame

PERIOD = 0.1  # s between images that are looked at
BLIND = 2.0  # s without an image after which the camera counts as stalled
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

    `length` [m] is the ruler's length of the board's squares; on the twin it is measured there.
    Raises Interrupted, and Fault where the camera delivers nothing.
    """
    aids = devices.aids
    views = BoardViews(settings.boards, patient=aids is None)
    devices.camera.connect()
    try:
        source = aids.show_board if aids is not None else _live(devices)
        first = source(WantedView(0.5, 0.5, settings.boards.sizes[1]))
        if length is None and aids is not None:
            length = aids.measure_board()
        keep = SessionFolder(folder, _session(settings, devices, first, length))
        note = Note(keep)

        newest = first

        def both(news: ViewNews) -> None:
            nonlocal newest
            newest = news.frame or newest
            note(news)
            watch(news)

        show(views, source, operator, both, interrupted)
    finally:
        devices.camera.close()
    if length is not None:
        views.measured(length)
    verdict = views.verdict()
    keep_lens(folder, verdict, devices.camera_identity)
    drawn = views_picture(newest.image, views.views, verdict.per_view)
    write_image(folder / PICTURE, drawn)
    return LensSession(folder, verdict)


def show(
    views: BoardViews,
    source: Source,
    operator: Operator,
    watch: Callable[[ViewNews], None],
    interrupted: Callable[[], bool],
) -> None:
    """Show one view after the other until the wizard asks for none; raises
    Interrupted on request.
    """
    while (wanted := views.ask()) is not None:
        if interrupted():
            raise Interrupted("calibration was interrupted; what was told so far is kept")
        missing = [gate for gate in views.gates() if not gate.passed]
        why = f"still missing: {missing[0]}" if missing else "all is covered; for good measure"
        watch(ViewNews(wanted, why, views.gates()))
        answer = operator.answer(Question(Ask.VIEW, f"show the board: {wanted}"))
        if answer is Answer.SKIP:
            views.skip()
            continue
        if answer is Answer.AGAIN:
            views.drop_last()
            continue
        frame = source(wanted)
        told = views.tell(frame)
        if told.waits:
            frame = source(wanted)
            told = views.tell(frame)
        watch(ViewNews(views.ask(), why, views.gates(), frame, told))


def keep_lens(folder: Path, verdict: LensVerdict, camera: str) -> None:
    """Write the verdict, and the lens in ROS and OpenCV formats if it passed."""
    content = {
        "passed": verdict.passed,
        "lines": [line.text for line in lens_lines(verdict)],
        "rms_px": None if verdict.fit is None else verdict.fit.rms,
        "per_view_px": {str(number): rms for number, rms in verdict.per_view.items()},
    }
    write_yaml(folder / VERDICT, content)
    if verdict.fit is not None and verdict.passed:
        write_camera_info(verdict.fit.lens, camera, folder / ROS)
        write_opencv(verdict.fit.lens, folder / OPENCV)


def _live(devices: Devices) -> Source:
    """Images of the live camera, a tenth of a second apart; a person holds the board."""
    newest = [-1.0]

    def look(_: WantedView) -> Frame:
        asked = devices.clock.now()
        while devices.clock.now() < asked + BLIND:
            devices.clock.wait_until(devices.clock.now() + PERIOD)
            frame = devices.camera.read(newest[0], timeout=0.0)
            if frame is not None:
                newest[0] = frame.stamp
                return frame
        raise Fault("camera_stalled", f"no image in {BLIND:.0f} s; look at the camera's cable")

    return look


def _session(settings: CellFile, devices: Devices, first: Frame, length: float | None) -> Session:
    return Session(
        schema=1,
        kind="camera",
        date=datetime.now(UTC).isoformat(timespec="seconds"),
        camera=devices.camera_identity,
        image=(first.image.shape[1], first.image.shape[0]),
        locks=dict(devices.camera_locks()),
        length=length,
        boards=settings.boards,
    )


def newest_lens(folder: Path, camera: str) -> Path:
    """The newest lens of `camera` among the sessions in `folder`; none is a ConfigurationError."""
    found = sorted(folder.glob(f"*/{ROS}"))
    for path in reversed(found):
        if f"camera_name: {camera}\n" in path.read_text(encoding="utf-8"):
            return path
    raise ConfigurationError(
        f"--lens: {folder} holds no lens of camera {camera}; run `cell calibrate camera` first, "
        "or name a file of ROS or OpenCV"
    )
