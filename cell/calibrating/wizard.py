"""Wizards `camera` and `homography` and the `check`: sessions over tasks by ask and tell.

A session is a folder: what was measured is written at once, it can go on after an interruption, and
it can be solved again from its images.
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from math import isnan
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from calibration.calibration import Calibration, make_calibration, save_calibration
from calibration.landmarks import Landmarks
from calibration.lens import CameraFile, Lens, write_camera_info, write_opencv
from calibration.wizard.board_views import BoardViews
from calibration.wizard.coverage import WantedView
from calibration.wizard.latency import NOT_MEASURED, LatencyVerdict, latency_verdict
from calibration.wizard.lens_verdict import LensVerdict
from calibration.wizard.progress import Observer, draw_picture
from calibration.wizard.session import (
    PICTURE_FILE,
    SESSION_FILE,
    VERDICT_FILE,
    Kind,
    Session,
    SessionFolder,
    begin_or_resume,
    read_latency,
    read_session,
    restore,
    write_image,
    write_yaml,
)
from calibration.wizard.touch_verdict import (
    CheckVerdict,
    TouchVerdict,
    check_verdict,
    map_lines,
    refusals,
)
from calibration.wizard.touched_points import TouchedPoints
from calibration.wizard.touches import check_plan
from calibration.wizard.verdict import Line
from cell.config.cell import CellFile
from cell.devices.devices import Devices
from cell.orchestrator.context import CalibrationContext
from cell.orchestrator.operator import Answer, Ask, Interrupted, Operator, Question
from cell.orchestrator.recorder import Record
from cell.orchestrator.run import Run
from drivers.errors import ConfigurationError, Fault
from drivers.files import writing
from drivers.readers import read_text
from drivers.settings import Settings, load
from drivers.types import Frame, Pose

PERIOD = 0.1  # s between processed images
STALL_TIMEOUT = 2.0  # s without an image after which the camera counts as stalled
ROS, OPENCV = "camera_info.yaml", "opencv.yaml"
CALIBRATION_FILE, POSES_FILE, LANDMARKS_FILE = "calibration.yaml", "poses.yaml", "landmarks.yaml"

Source = Callable[[WantedView], Frame]
Interruption = Callable[[], bool]


class PosesFile(Settings):
    """Contents of poses.yaml: x, z [m] and pitch [rad] of every touch, for editing and replay."""

    poses: tuple[tuple[float, float, float], ...]


@dataclass(frozen=True, slots=True)
class LensSession:
    """Result of a session with the board; `folder` is None where it was solved again in memory."""

    folder: Path | None
    verdict: LensVerdict

    @property
    def passed(self) -> bool:
        """Whether the lens may be used."""
        return self.verdict.passed

    @property
    def lines(self) -> tuple[Line, ...]:
        """Lines of the verdict on the lens, for the operator."""
        return self.verdict.lines()

    def facts(self) -> dict[str, Any]:
        """Plain values of the result, as `--json` prints them."""
        verdict, fit = self.verdict, self.verdict.fit
        return {
            "passed": verdict.passed,
            "views": verdict.views,
            "rms_px": None if fit is None else fit.rms,
            "halves_mm": None if fit is None else verdict.bend_mm,
            "reasons": list(verdict.reasons),
        }

    def keep(self, folder: Path, camera: str) -> None:
        """Write the verdict to `folder`, and the lens in ROS and OpenCV formats if it passed."""
        fit = self.verdict.fit
        content = {
            "passed": self.passed,
            "lines": [line.text for line in self.lines],
            "rms_px": None if fit is None else fit.rms,
            "per_view_px": {str(number): rms for number, rms in self.verdict.per_view.items()},
        }
        write_yaml(folder / VERDICT_FILE, content)
        if fit is not None and self.passed:
            write_camera_info(fit.lens, camera, folder / ROS)
            write_opencv(fit.lens, folder / OPENCV)


@dataclass(frozen=True, slots=True)
class TouchSession:
    """Result of a session of touches; `calibration` is None where it was not accepted.

    `speed` [m/s] is that of a fold, to state what a latency amounts to.
    """

    folder: Path | None
    touches: TouchVerdict
    latency: LatencyVerdict
    calibration: Calibration | None
    speed: float

    @property
    def passed(self) -> bool:
        """Whether a calibration was accepted."""
        return self.calibration is not None

    @property
    def lines(self) -> tuple[Line, ...]:
        """Lines of the verdict on map and latency, for the operator."""
        return map_lines(self.touches, self.latency, self.speed)

    def facts(self) -> dict[str, Any]:
        """Plain values of the result, as `--json` prints them."""
        keys = ("residual_mm", "worst_mm", "halves_mm", "displacement_mm")
        late = self.latency.latency
        return {
            "accepted": self.passed,
            "calibration": None if self.calibration is None else self.calibration.id,
            **{key: getattr(self.touches, key) for key in keys},
            "latency": None if isnan(late) else late,
            "reasons": list(refusals(self.touches, self.latency)),
        }

    def keep(self, folder: Path) -> None:
        """Write the verdict to `folder`, and the calibration where accepted."""
        content = {
            "accepted": self.passed,
            "calibration": None if self.calibration is None else self.calibration.id,
            "lines": [line.text for line in self.lines],
            "errors_mm": {str(n): error for n, error in self.touches.errors_mm.items()},
        }
        write_yaml(folder / VERDICT_FILE, content)
        if self.calibration is not None:
            save_calibration(self.calibration, folder / CALIBRATION_FILE)


def calibrate_lens(
    settings: CellFile,
    devices: Devices,
    folder: Path,
    operator: Operator,
    watch: Observer,
    length: float | None,
    interrupted: Interruption = lambda: False,
) -> LensSession:
    """Ask for views of the board until they suffice, and keep session and lens in `folder`.

    A session that was interrupted there goes on. `length` [m] is the ruler's length of the board's
    squares; on the twin it is measured there, and a session that goes on knows it.
    Raises Interrupted, and Fault where the camera delivers nothing.
    """
    aids = devices.aids
    devices.camera.connect()
    try:
        source = aids.show_board if aids is not None else _live_images(devices)
        first = source(WantedView(0.5, 0.5, settings.boards.sizes[1]))
        if length is None and aids is not None:
            length = aids.measure_board()
        size = (first.image.shape[1], first.image.shape[0])
        facts = {"length": length, "boards": settings.boards}
        session = begin_or_resume(folder, _new_session("camera", devices, size, **facts))
        views = BoardViews(settings.boards, patient=aids is None, size=size)
        keep = SessionFolder(folder, session, watch)
        restore(views, folder, session)
        show_board(views, source, operator, keep, interrupted)
    finally:
        devices.camera.close()
    result = LensSession(folder, views.verdict(session.length))
    result.keep(folder, devices.camera_identity)
    drawn = draw_picture((keep.newest or first).image, views.marks, result.verdict.title)
    write_image(folder / PICTURE_FILE, drawn)
    return result


def refit_lens(folder: Path, without: Collection[int], out: Path | None) -> LensSession:
    """Fit the lens of the session in `folder` again, `without` some images, into `out` if given.

    Boards are detected anew in the saved images. Raises ConfigurationError for broken files.
    """
    cv2.setNumThreads(1)  # in several threads the last digits differ from time to time
    session = read_session(folder, "camera")
    views = BoardViews(session.boards, size=session.image)
    restore(views, folder, session, without)
    result = LensSession(out, views.verdict(session.length))
    if out is not None:
        with writing(f"--out: {out}"):
            out.mkdir(parents=True, exist_ok=True)
        result.keep(out, session.camera)
    return result


def calibrate_homography(
    settings: CellFile,
    devices: Devices,
    lens: Lens,
    folder: Path,
    operator: Operator,
    watch: Observer,
    *,
    plan: Sequence[Pose] | None = None,
    accept_anyway: bool = False,
    interrupted: Interruption = lambda: False,
) -> TouchSession:
    """Calibrate homography and latency with the arm, and keep the session in `folder`.

    A session that was interrupted there goes on with the points that it lacks.
    Raises Fault when a monitor stopped the arm and Interrupted when the operator did; the data
    until then stay in `folder`.
    """
    if (folder / SESSION_FILE).exists():
        plan = read_poses(folder / POSES_FILE)
    now = _new_session(
        "homography",
        devices,
        (lens.width, lens.height),
        lens=CameraFile.of(lens, devices.camera_identity),
        touches=settings.touches,
        latency=settings.latency,
    )
    session = begin_or_resume(folder, now)
    points = TouchedPoints(lens, settings.touches, plan)
    keep = SessionFolder(folder, session, watch)
    write_yaml(folder / POSES_FILE, {"poses": [[p.x, p.z, p.pitch] for p in points.plan]})
    restore(points, folder, session)
    context = CalibrationContext(settings.controller, points, operator, keep, remembers=True)
    touches = touch_all(devices, context, interrupted)
    # locks as read back
    facts: dict[str, Any] = {"locks": devices.camera_locks(), "landmarks": context.landmarks}
    found = lens, touches, context.latency, session.camera
    made = build_calibration(*found, accept_anyway=accept_anyway, **facts)
    result = TouchSession(folder, touches, context.latency, made, settings.fold.speed)
    result.keep(folder)
    if context.landmarks is not None:
        write_yaml(folder / LANDMARKS_FILE, context.landmarks.model_dump(mode="json"))
    if keep.newest is not None:
        drawn = draw_picture(keep.newest.image, points.marks(touches), touches.title)
        write_image(folder / PICTURE_FILE, drawn)
    return result


def refit_homography(
    folder: Path,
    without: Collection[int],
    out: Path | None,
    speed: float,
    *,
    accept_anyway: bool = False,
) -> TouchSession:
    """Fit homography and latency of the session in `folder` again, `without` some points.

    The pointer is detected anew in the saved images; verdict and accepted calibration are written
    to `out`, if given. Raises ConfigurationError for broken files or a session without a lens.
    """
    cv2.setNumThreads(1)  # in several threads the last digits differ from time to time
    session, lens = read_session(folder, "homography"), lens_of(folder)
    points = TouchedPoints(lens, session.touches, (), fitted=False)
    restore(points, folder, session, without)
    touches, latency, steps = points.verdict(), NOT_MEASURED, read_latency(folder)
    if steps.arm and touches.homography is not None:
        arm, seen = np.array(steps.arm), np.reshape(steps.seen, (-1, 3))
        latency = latency_verdict(arm, seen, lens, touches.homography, session.latency)
    path = folder / LANDMARKS_FILE
    marks = load(path, Landmarks) if path.exists() else None
    found = lens, touches, latency, session.camera
    facts: dict[str, Any] = {"locks": session.locks, "landmarks": marks}
    made = build_calibration(*found, accept_anyway=accept_anyway, **facts)
    result = TouchSession(out, touches, latency, made, speed)
    if out is not None:
        with writing(f"--out: {out}"):
            out.mkdir(parents=True, exist_ok=True)
        result.keep(out)
    return result


def check_calibration(
    settings: CellFile,
    devices: Devices,
    calibration: Calibration,
    operator: Operator,
    watch: Observer,
    interrupted: Interruption = lambda: False,
) -> CheckVerdict:
    """Touch each pose of the check's plan and return the verdict on `calibration`.

    Raises ConfigurationError for one of another camera, Fault when a monitor stopped the arm, and
    Interrupted when the operator did.
    """
    if calibration.camera != devices.camera_identity:
        raise ConfigurationError(
            f"calibration: {calibration.id} belongs to camera {calibration.camera}, this one is "
            f"{devices.camera_identity}; name its own"
        )
    plan = check_plan(settings.touches)
    points = TouchedPoints(calibration.lens, settings.touches, plan, fitted=False)
    run_calibration(
        devices, CalibrationContext(settings.controller, points, operator, watch), interrupted
    )
    return check_verdict(points.touches, calibration, settings.touches)


def run_calibration(
    devices: Devices, context: CalibrationContext, interrupted: Interruption
) -> None:
    """Run the calibration of `context`; raises Interrupted or Fault where it was stopped."""
    try:
        devices.connect()
        outcome = Run(devices, context, Record(), interrupted=interrupted).execute()
    finally:
        devices.close()
    if outcome.exit_code == Interrupted.exit_code:
        raise Interrupted(f"calibration was {outcome.name}: {outcome.reason}")
    if outcome.exit_code != 0:
        raise Fault(outcome.name, f"calibration was stopped: {outcome.reason}")


def touch_all(
    devices: Devices, context: CalibrationContext, interrupted: Interruption
) -> TouchVerdict:
    """Touch all points of `context`; returns the verdict on their map, raises as the run does."""
    run_calibration(devices, context, interrupted)
    if context.touches is None:
        raise Fault("illegal_event", "the calibration ended without a verdict")
    return context.touches


def build_calibration(
    lens: Lens,
    touches: TouchVerdict,
    latency: LatencyVerdict,
    camera: str,
    *,
    accept_anyway: bool = False,
    **facts: Any,
) -> Calibration | None:
    """Calibration of these parts and other `facts`; None where it is refused or has no map."""
    reasons = refusals(touches, latency)
    if touches.homography is None or (reasons and not accept_anyway):
        return None
    return make_calibration(
        lens,
        touches.homography,
        residual_mm=touches.residual_mm,
        latency=0.0 if isnan(latency.latency) else latency.latency,
        date=datetime.now(UTC).isoformat(timespec="seconds"),
        camera=camera,
        accepted_anyway=reasons,
        **facts,
    )


def lens_of(folder: Path) -> Lens:
    """Lens of the touch session in `folder`; raises ConfigurationError where it has none."""
    session = read_session(folder, "homography")
    if session.lens is None:
        raise ConfigurationError(f"{folder}: session.yaml: lens: is missing; add it")
    return session.lens.lens(f"{folder}: lens")


def newest_lens(folder: Path, camera: str) -> Path:
    """Newest lens file of `camera` under `folder`; raises ConfigurationError without one."""
    for path in sorted(folder.glob(f"*/{ROS}"), reverse=True):
        if f"camera_name: {camera}\n" in read_text(path):
            return path
    raise ConfigurationError(
        f"--lens: {folder} holds no lens of camera {camera}; run `cell calibrate camera` first, "
        "or name a file of ROS or OpenCV"
    )


def read_poses(path: Path) -> tuple[Pose, ...]:
    """Pose of every touch (x, z, pitch) in a poses.yaml; ConfigurationError for a broken file."""
    return tuple(Pose(x, z, pitch) for x, z, pitch in load(path, PosesFile).poses)


def _new_session(kind: Kind, devices: Devices, size: tuple[int, int], **facts: Any) -> Session:
    """A session that begins now, of images of width and height `size` [px]."""
    return Session(
        schema=1,
        kind=kind,
        date=datetime.now(UTC).isoformat(timespec="seconds"),
        camera=devices.camera_identity,
        image=size,
        locks=dict(devices.camera_locks()),
        **facts,
    )


def show_board(
    views: BoardViews,
    source: Source,
    operator: Operator,
    watch: Observer,
    interrupted: Interruption = lambda: False,
) -> None:
    """Request views of the board one after the other until enough are accepted.

    Raises Interrupted when the operator stops it.
    """
    while (wanted := views.ask()) is not None:
        _check(interrupted)
        progress = views.progress()
        watch(progress)
        answer = operator.answer(Question(Ask.VIEW, progress.request))
        _check(interrupted)
        if answer is Answer.SKIP:
            views.skip()
        elif answer is Answer.AGAIN:
            watch(replace(progress, taken_back=views.take_back()))
        else:
            frame = source(wanted)
            result = views.tell(frame)
            if result.waits:  # the next image decides
                frame = source(wanted)
                result = views.tell(frame)
            watch(views.progress(frame, result))


def _check(interrupted: Interruption) -> None:
    if interrupted():
        raise Interrupted("the calibration was interrupted")


def _live_images(devices: Devices) -> Source:
    """Source of live images, PERIOD apart, while a person holds the board."""
    newest = -1.0

    def look(_: WantedView) -> Frame:
        nonlocal newest
        asked = devices.clock.now()
        while devices.clock.now() < asked + STALL_TIMEOUT:
            devices.clock.wait_until(devices.clock.now() + PERIOD)
            frame = devices.camera.read(newest, timeout=0.0)
            if frame is not None:
                newest = frame.stamp
                return frame
        raise Fault(
            "camera_stalled", f"no image in {STALL_TIMEOUT:.0f} s; look at the camera's cable"
        )

    return look
