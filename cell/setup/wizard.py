"""Wizard that calibrates a cell's camera, its lens and homography, and checks a
calibration.

A session is a folder: what was measured is written at once, it can go on after an
interruption, and its verdict is solved from what the folder holds, at its end as at any
later time.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

import cv2

from calibration.calibration import Calibration, save_calibration
from calibration.lens import CameraFile, Lens, write_camera_info, write_opencv
from calibration.view import Landmarks
from calibration.wizard import session
from calibration.wizard.board_views import BoardViews
from calibration.wizard.coverage import WantedView
from calibration.wizard.lens_verdict import LensVerdict
from calibration.wizard.progress import Mark, Observer, draw_picture, ignore
from calibration.wizard.touch_verdict import (
    CheckVerdict,
    MapVerdict,
    check_verdict,
    map_verdict,
)
from calibration.wizard.touched_points import TouchedPoints
from calibration.wizard.touches import check_plan
from calibration.wizard.verdict import CalibrationVerdict
from cell.base.config.cell import CellFile
from cell.base.devices.devices import CalibrationAids, Devices, Trial
from cell.base.devices.open import NO_STRIP, open_cell
from cell.orchestrator.calibration_phase import CALIBRATION_PHASES
from cell.orchestrator.context import CalibrationInputs, CalibrationLog
from cell.orchestrator.operator import (
    Answer,
    Interrupted,
    Operator,
    Question,
    Unattended,
)
from cell.orchestrator.recorder import Recorder
from cell.orchestrator.run import ControlLoop
from drivers.base.errors import CellError, ConfigurationError, Fault
from drivers.base.readers import read_text
from drivers.base.settings import Settings, load
from drivers.base.types import Array, Frame, Image, Pose

PERIOD = 0.1  # s between processed images
STALL_TIMEOUT = 2.0  # s without an image after which the camera counts as stalled
ROS = "camera_info.yaml"
OPENCV = "opencv.yaml"
CALIBRATION_FILE = "calibration.yaml"
LANDMARKS_FILE = "landmarks.yaml"

Source = Callable[[WantedView], Frame]
Interruption = Callable[[], bool]


@dataclass(frozen=True, slots=True)
class Wizard:
    """Guide for the calibration of the camera among the `devices` of a cell, which asks
    an `operator` for views of a board and for touched points.

    `watch` is told the progress. Every method raises Interrupted when the operator
    stops it, and Fault where a monitor stops the arm or the camera delivers nothing;
    what was measured until then stays in the session's folder, from which another call
    goes on.
    """

    settings: CellFile
    devices: Devices
    operator: Operator
    watch: Observer = ignore
    interrupted: Interruption = lambda: False

    def calibrate_lens(self, folder: Path, length: float | None) -> LensVerdict:
        """Fit the lens to views of the calibration board, asked for until enough are
        accepted, and return the verdict on it.

        The session is kept in `folder`. `length` [m] is the ruler's length of the
        board's squares; on the twin they are as configured, and a session that goes on
        knows it.
        """
        devices = self.devices
        boards = self.settings.boards
        aids = devices.aids
        with closing(devices.camera):
            devices.camera.connect()
            live = live_images(devices)
            source: Source = (lambda _: next(live)) if aids is None else aids.show_board
            first = source(WantedView(0.5, 0.5, boards.sizes[1]))
            if length is None and aids is not None:
                length = boards.width
            size = (first.image.shape[1], first.image.shape[0])
            views = BoardViews(boards, size, patient=aids is None)
            keep = self._open_session(
                "camera", folder, views, size, length=length, boards=boards
            )
            show_board(
                views, source, self.operator, watch=keep, interrupted=self.interrupted
            )
        return solve_lens(folder, (), folder)

    def calibrate_homography(
        self,
        lens: Lens,
        folder: Path,
        plan: Sequence[Pose] | None = None,
        *,
        accept_anyway: bool = False,
    ) -> MapVerdict:
        """Touch points with the arm and fit the map from the image to the strip's
        plane, and the camera's latency, to them; returns the verdict on both.

        The session is stored in `folder`.
        """
        settings = self.settings
        if (folder / session.SESSION_FILE).exists():
            plan = read_poses(folder / session.POSES_FILE)
        points = TouchedPoints(lens, settings.touches, plan)
        with closing(self.devices):
            self.devices.camera.connect()  # which locks its controls
            keep = self._open_session(
                "homography",
                folder,
                points,
                lens.size,
                lens=CameraFile.from_lens(lens, self.devices.camera_identity),
                touches=settings.touches,
                latency=settings.latency,
            )
            poses = [[pose.x, pose.z, pose.pitch] for pose in points.plan]
            session.write_yaml(folder / session.POSES_FILE, {"poses": poses})
            log = self.touch(points, keep, remembers=True)
        if log.landmarks is not None:
            session.write_yaml(
                folder / LANDMARKS_FILE, log.landmarks.model_dump(mode="json")
            )
        return solve_homography(folder, (), folder, accept_anyway=accept_anyway)

    def check(self, calibration: Calibration) -> CheckVerdict:
        """Judge a `calibration` that is in use by a few points that the arm touches;
        the devices are closed afterwards.
        """
        touches = self.settings.touches
        points = TouchedPoints(
            calibration.lens, touches, check_plan(touches), fitted=False
        )
        with closing(self.devices):
            self.touch(points, self.watch)
        return check_verdict(points.touches, calibration, touches)

    def touch(
        self, points: TouchedPoints, watch: Observer, *, remembers: bool = False
    ) -> CalibrationLog:
        """Move the arm until it has touched all `points`, and return the log of that;
        raises Interrupted or Fault where it was stopped.

        Landmarks are taken afterwards if it `remembers`; `watch` is told the progress.
        """
        given = CalibrationInputs(
            settings=self.settings.controller,
            points=points,
            operator=self.operator,
            watch=watch,
            aids=self.devices.aids,
            remembers=remembers,
        )
        self.devices.connect()
        log = CalibrationLog()
        run = ControlLoop(
            devices=self.devices,
            inputs=given,
            log=log,
            phases=CALIBRATION_PHASES,
            recorder=Recorder(),
            interrupted=self.interrupted,
        )
        outcome = run.execute()
        if outcome.exit_code == Interrupted.exit_code:
            raise Interrupted(f"calibration was {outcome.name}: {outcome.reason}")
        if outcome.exit_code != 0:
            raise Fault(outcome.name, f"calibration was stopped: {outcome.reason}")
        return log

    def _open_session(
        self,
        kind: session.Kind,
        folder: Path,
        task: session.Task,
        size: tuple[int, int],
        **facts: Any,
    ) -> session.SessionFolder:
        """Begin a session of images with width and height `size` [px] in `folder`, or
        resume the one that `folder` holds.

        What it has taken before is given to the `task`.
        """
        stated = session.SessionFile(
            schema=1,
            kind=kind,
            date=datetime.now(UTC).isoformat(timespec="seconds"),
            camera=self.devices.camera_identity,
            image=size,
            locks=dict(self.devices.camera_locks()),
            **facts,
        )
        keep = session.SessionFolder(folder, stated, self.watch)
        session.restore(task, folder, keep.session)
        return keep


def solve_lens(folder: Path, without: Collection[int], out: Path | None) -> LensVerdict:
    """Fit the lens to the saved images of the session in `folder`, except those whose
    numbers are in `without`, and return the verdict on it.

    Boards are detected in the saved images; verdict and passed lens are written to
    `out`, if given. Raises ConfigurationError for broken files.
    """
    cv2.setNumThreads(1)  # in several threads the last digits differ from time to time
    stored = session.read_session(folder, "camera")
    views = BoardViews(stored.boards, stored.image)
    image = session.restore(views, folder, stored, without)
    verdict = views.verdict(stored.length)
    if out is not None:
        _keep(out, verdict, image, views.marks)
        if verdict.fit is not None and verdict.passed:
            write_camera_info(verdict.fit.lens, stored.camera, out / ROS)
            write_opencv(verdict.fit.lens, out / OPENCV)
    return verdict


def solve_homography(
    folder: Path,
    without: Collection[int],
    out: Path | None,
    *,
    accept_anyway: bool = False,
) -> MapVerdict:
    """Fit the map to the plane and the latency to the saved session in `folder`, except
    the points whose numbers are in `without`; returns the verdict.

    The pointer is detected in the saved images; verdict and accepted calibration are
    written to `out`, if given. Raises ConfigurationError for broken files or a session
    without a lens.
    """
    cv2.setNumThreads(1)  # in several threads the last digits differ from time to time
    stored = session.read_session(folder, "homography")
    lens = session_lens(folder)
    points = TouchedPoints(lens, stored.touches, (), fitted=False)
    image = session.restore(points, folder, stored, without)
    path = folder / LANDMARKS_FILE
    verdict = map_verdict(
        points.verdict(),
        session.read_steps(folder),
        stored.latency,
        anyway=accept_anyway,
        camera=stored.camera,
        locks=stored.locks,
        landmarks=load(path, Landmarks) if path.exists() else None,
    )
    if out is not None:
        touches = verdict.touches
        deviation = partial(points.deviation, touches)
        _keep(
            folder=out,
            verdict=verdict,
            image=image,
            marks=points.marks(touches),
            deviation=deviation,
        )
        if verdict.calibration is not None:
            save_calibration(verdict.calibration, out / CALIBRATION_FILE)
    return verdict


def _keep(
    folder: Path,
    verdict: CalibrationVerdict,
    image: Image | None,
    marks: Iterable[Mark],
    deviation: Callable[[Array], Array] | None = None,
) -> None:
    """Write `verdict` into `folder` and, unless `image` is None, a picture of it with
    `marks` and with lines of equal accuracy.
    """
    session.write_yaml(folder / session.VERDICT_FILE, verdict.facts())
    if image is not None:
        picture = draw_picture(image, marks, deviation)
        session.write_image(folder / session.PICTURE_FILE, picture)


def calibrate_twin(settings: CellFile, interrupted: Interruption) -> Calibration:
    """Calibrate lens, map and latency of a simulated cell's camera, with no operator
    and no saved session, and return the calibration.

    Raises CellError when they are not good enough, Fault when a monitor stopped the
    arm, and Interrupted when the operator did.
    """
    twin = settings.with_drivers("twin", "twin")
    devices = open_cell(twin, NO_STRIP, Trial(), calibrating=True)
    if devices.aids is None:
        raise ConfigurationError("calibrate: nobody holds the board; use the wizard")
    lens = lens_from_boards(settings, devices.aids)
    points = TouchedPoints(lens, settings.touches)
    wizard = Wizard(settings, devices, Unattended(), interrupted=interrupted)
    with closing(devices):
        log = wizard.touch(points, ignore)
    camera = devices.camera_identity
    verdict = map_verdict(points.verdict(), log.steps, settings.latency, camera=camera)
    if verdict.calibration is None:
        raise CellError("homography failed: " + "; ".join(verdict.reasons))
    return verdict.calibration


def lens_from_boards(settings: CellFile, aids: CalibrationAids) -> Lens:
    """Fit the lens of a simulated camera to as many views of the board as are needed;
    CellError where the fit is poor.
    """
    camera = settings.twin.camera
    views = BoardViews(settings.boards, (camera.width, camera.height))
    show_board(views, aids.show_board, Unattended(), ignore)
    verdict = views.verdict(settings.boards.width)
    if verdict.fit is None or not verdict.passed:
        raise CellError("lens calibration failed: " + "; ".join(verdict.reasons))
    return verdict.fit.lens


def show_board(
    views: BoardViews,
    source: Source,
    operator: Operator,
    watch: Observer,
    interrupted: Interruption = lambda: False,
) -> None:
    """Ask for views of the board, and tell `views` the images from `source`, until
    enough are accepted; raises Interrupted where the operator stops this.
    """
    while (wanted := views.ask()) is not None:
        progress = views.progress()
        watch(progress)
        answer = operator.answer(Question(progress.request))
        if interrupted():
            raise Interrupted("the calibration was interrupted")
        if answer is Answer.SKIP:
            views.skip()
        elif answer is Answer.AGAIN:
            watch(replace(progress, result=views.take_back()))
        else:
            frame = source(wanted)
            result = views.tell(frame)
            if result.waits:  # the next image decides
                frame = source(wanted)
                result = views.tell(frame)
            watch(views.progress(frame, result))


def live_images(devices: Devices) -> Iterator[Frame]:
    """Yield live images of the connected camera of `devices`, one in each fixed period;
    Fault where none comes.
    """
    now = devices.clock.now
    newest = -1.0
    while True:
        start = now()
        frame = None
        while frame is None:
            if now() >= start + STALL_TIMEOUT:
                reason = (
                    f"no image in {STALL_TIMEOUT:.0f} s; look at the camera's cable"
                )
                raise Fault("camera_stalled", reason)
            devices.clock.wait_until(now() + PERIOD)
            frame = devices.camera.read(newest, timeout=0.0)
        newest = frame.stamp
        yield frame


class PosesFile(Settings):
    """Contents of poses.yaml: x, z [m] and pitch [rad] of each touch, to be edited and
    replayed.
    """

    poses: tuple[tuple[float, float, float], ...]


def read_poses(path: Path) -> tuple[Pose, ...]:
    """Poses of all touches from the file at `path`, which a person may have edited;
    ConfigurationError where it is broken.
    """
    return tuple(Pose(x, z, pitch) for x, z, pitch in load(path, PosesFile).poses)


def session_lens(folder: Path) -> Lens:
    """Lens that the session of touches in `folder` has used; ConfigurationError where
    it states none.
    """
    stored = session.read_session(folder, "homography")
    if stored.lens is None:
        raise ConfigurationError(f"{folder}: session.yaml: lens: is missing; add it")
    return stored.lens.lens(f"{folder}: lens")


def newest_lens(folder: Path, camera: str) -> Path:
    """Path of the newest lens file of the camera named `camera` below `folder`;
    ConfigurationError where there is none.
    """
    for path in sorted(folder.glob(f"*/{ROS}"), reverse=True):
        if f"camera_name: {camera}\n" in read_text(path):
            return path
    raise ConfigurationError(
        f"--lens: {folder} holds no lens of camera {camera}; run `cell calibrate"
        " camera` first, or name a file of ROS or OpenCV"
    )
