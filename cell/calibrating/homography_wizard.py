"""`cell calibrate homography` and `check`: touch points, then fit a homography or check one."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import cv2
import numpy as np

from calibration.calibration import Calibration, make_calibration, save_calibration
from calibration.landmarks import Landmarks
from calibration.lens import CameraFile, Lens
from calibration.pointer import find_pointer
from calibration.wizard.latency import LatencyVerdict, SeenStep, latency_verdict
from calibration.wizard.news import News, TouchNews, Watcher
from calibration.wizard.picture import touches_picture
from calibration.wizard.session import (
    PICTURE_FILE,
    SESSION_FILE,
    VERDICT_FILE,
    Session,
    SessionFolder,
    make_folder,
    new_session,
    read_latency,
    read_session,
    session_to_resume,
    taken_images,
    write_image,
    write_yaml,
)
from calibration.wizard.touch_verdict import (
    CheckVerdict,
    TouchVerdict,
    refusals,
    touch_lines,
    touch_verdict,
)
from calibration.wizard.touches import BegunPlan, Touched, held_out, touch_plan
from cell.config.cell import CellFile
from cell.devices.devices import Devices
from cell.orchestrator.context import CalibrationContext
from cell.orchestrator.interrupt import Interrupted
from cell.orchestrator.operator import Operator
from cell.orchestrator.recorder import Record
from cell.orchestrator.run import Run
from drivers.errors import CellError, ConfigurationError, Fault
from drivers.settings import Settings, load
from drivers.types import Pose

CALIBRATION_FILE, POSES_FILE, LANDMARKS_FILE = "calibration.yaml", "poses.yaml", "landmarks.yaml"


class PosesFile(Settings):
    """Contents of poses.yaml: x, z [m] and pitch [rad] of every touch, for editing and replay."""

    poses: tuple[tuple[float, float, float], ...]


@dataclass(frozen=True, slots=True)
class TouchSession:
    """Result of a session of touches; `calibration` is None where it was not accepted."""

    folder: Path | None
    touches: TouchVerdict | None
    latency: LatencyVerdict | None
    calibration: Calibration | None


def calibrate_homography(
    settings: CellFile,
    devices: Devices,
    lens: Lens,
    folder: Path,
    operator: Operator,
    watch: Watcher,
    *,
    plan: Sequence[Pose] | None = None,
    accept_anyway: bool = False,
    interrupted: Callable[[], bool] = lambda: False,
) -> TouchSession:
    """Calibrate homography and latency with the arm, and keep the session in `folder`.

    A session that was interrupted there goes on with the points that it lacks.
    Raises Fault when a monitor stopped the arm and Interrupted when the operator did; the data
    until then stay in `folder`.
    """
    session, poses = _start_or_resume(settings, devices, lens, folder, plan)
    keep = SessionFolder(folder, session, watch)
    write_yaml(folder / POSES_FILE, {"poses": [[p.x, p.z, p.pitch] for p in poses]})
    context = CalibrationContext(
        settings.controller, lens, operator=operator, watch=keep, plan=poses, remembers=True
    )
    touch(devices, context, interrupted)
    found = context.touches, context.latency
    session = session.model_copy(update={"locks": dict(devices.camera_locks())})  # as read back
    made = _make_calibration(session, lens, *found, context.landmarks, accept_anyway=accept_anyway)
    result = TouchSession(folder, *found, made)
    _keep_verdict(folder, result, settings.fold.speed)
    if context.landmarks is not None:
        write_yaml(folder / LANDMARKS_FILE, context.landmarks.model_dump(mode="json"))
    _keep_picture(folder, keep.newest, lens, context.touches)
    return result


def _start_or_resume(
    settings: CellFile, devices: Devices, lens: Lens, folder: Path, plan: Sequence[Pose] | None
) -> tuple[Session, tuple[Pose, ...]]:
    """Start a session with the settings' poses or those of `plan`, or resume that in `folder`."""
    facts = {"lens": CameraFile.of(lens, devices.camera_identity), "touches": settings.touches}
    facts |= {"latency": settings.latency}
    size, locks = (lens.width, lens.height), dict(devices.camera_locks())
    session = new_session("homography", devices.camera_identity, size, locks, **facts)
    if not (folder / SESSION_FILE).exists():
        return session, tuple(plan) if plan is not None else touch_plan(settings.touches)
    session = session_to_resume(folder, session)
    poses = BegunPlan(read_poses(folder / POSES_FILE))
    poses.touched = tuple(_accepted_points(folder, session, ()))
    return session, poses


def _keep_picture(
    folder: Path, newest: News | None, lens: Lens, verdict: TouchVerdict | None
) -> None:
    """Draw all touched points into the newest image and write it, where there is one."""
    if isinstance(newest, TouchNews) and newest.frame is not None and verdict is not None:
        drawn = touches_picture(newest.frame.image, newest.touches, lens, verdict)
        write_image(folder / PICTURE_FILE, drawn)


def homography_again(
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
    verdict = touch_verdict(_accepted_points(folder, session, without), lens, session.touches)
    latency = None
    steps = read_latency(folder)
    if steps.arm and verdict.homography is not None:
        seen = [SeenStep(t, np.array([u, v])) for t, u, v in steps.seen]
        latency = latency_verdict(
            np.array(steps.arm), seen, lens, verdict.homography, session.latency
        )
    path = folder / LANDMARKS_FILE
    marks = load(path, Landmarks) if path.exists() else None
    made = _make_calibration(session, lens, verdict, latency, marks, accept_anyway=accept_anyway)
    result = TouchSession(out, verdict, latency, made)
    if out is not None:
        make_folder(out)
        _keep_verdict(out, result, speed)
    return result


def check_calibration(
    settings: CellFile,
    devices: Devices,
    calibration: Calibration,
    operator: Operator,
    watch: Watcher,
    interrupted: Callable[[], bool] = lambda: False,
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
    context = CalibrationContext(
        settings.controller, calibration.lens, operator=operator, watch=watch, old=calibration
    )
    touch(devices, context, interrupted)
    if context.check is None:
        raise Fault("illegal_event", "the check ended without a verdict")
    return context.check


def touch(devices: Devices, context: CalibrationContext, interrupted: Callable[[], bool]) -> None:
    """Run the calibration of `context`; raises Interrupted or Fault where it was stopped."""
    try:
        devices.connect()
        outcome = Run(devices, context, Record(), interrupted=interrupted).execute()
    finally:
        devices.close()
    if outcome.exit_code == Interrupted.exit_code:
        raise Interrupted(f"calibration was {outcome.name}: {outcome.reason}")
    if outcome.exit_code != 0 or (context.touches is None and context.check is None):
        raise Fault(outcome.name, f"calibration was stopped: {outcome.reason}")


def assemble(
    lens: Lens,
    touches: TouchVerdict | None,
    latency: LatencyVerdict | None,
    *,
    camera: str,
    locks: dict[str, int] | None = None,
    landmarks: Landmarks | None = None,
    accept_anyway: bool = False,
) -> Calibration:
    """Make a calibration of these parts; raises CellError for defects that nobody overrides."""
    reasons = refusals(touches, latency)
    if touches is None or touches.homography is None or (reasons and not accept_anyway):
        raise CellError("homography failed: " + "; ".join(reasons))
    measured = latency is not None and not np.isnan(latency.latency)
    return make_calibration(
        lens,
        touches.homography,
        residual_mm=touches.residual_mm,
        latency=latency.latency if latency is not None and measured else 0.0,
        date=datetime.now(UTC).isoformat(timespec="seconds"),
        camera=camera,
        locks=locks,
        landmarks=landmarks,
        accepted_anyway=reasons,
    )


def lens_of(folder: Path) -> Lens:
    """Lens of the touch session in `folder`; raises ConfigurationError where it has none."""
    session = read_session(folder, "homography")
    if session.lens is None:
        raise ConfigurationError(f"{folder}: session.yaml: lens: is missing; add it")
    return session.lens.lens(f"{folder}: lens")


def read_poses(path: Path) -> tuple[Pose, ...]:
    """Read the pose of every touch (x, z, pitch) from a poses.yaml.

    Raises ConfigurationError for a broken file.
    """
    return tuple(Pose(x, z, pitch) for x, z, pitch in load(path, PosesFile).poses)


def _make_calibration(
    session: Session,
    lens: Lens,
    touches: TouchVerdict | None,
    latency: LatencyVerdict | None,
    landmarks: Landmarks | None,
    *,
    accept_anyway: bool,
) -> Calibration | None:
    """Make the calibration of a session; None where it is refused."""
    try:
        return assemble(
            lens,
            touches,
            latency,
            camera=session.camera,
            locks=session.locks,
            landmarks=landmarks,
            accept_anyway=accept_anyway,
        )
    except ConfigurationError:
        raise
    except CellError:
        return None


def _keep_verdict(folder: Path, found: TouchSession, speed: float) -> None:
    """Write the verdict on a session, and its calibration where accepted, to `folder`."""
    made, touches = found.calibration, found.touches
    content = {
        "accepted": made is not None,
        "calibration": None if made is None else made.id,
        "lines": [line.text for line in touch_lines(touches, found.latency, speed)],
        "errors_mm": {} if touches is None else {str(n): e for n, e in touches.errors_mm.items()},
    }
    write_yaml(folder / VERDICT_FILE, content)
    if made is not None:
        save_calibration(made, folder / CALIBRATION_FILE)


def _accepted_points(folder: Path, session: Session, without: Collection[int]) -> list[Touched]:
    """Accepted points of a session, one for each pose: that of its last touch."""
    touches: dict[tuple[int, bool], Touched] = {}
    for row, image in taken_images(folder, session, without):
        if row.pose is None:
            raise ConfigurationError(f"{folder}: point {row.number} has no pose; leave it out")
        centre = find_pointer(image)
        if centre is None:
            raise ConfigurationError(
                f"{folder / str(row.image)}: shows no pointer; leave number {row.number} out"
            )
        place, apart = np.array(row.pose[:2]), held_out(row.number, session.touches)
        touches[row.number, row.again] = Touched(row.number, place, centre, apart, again=row.again)
    return [*touches.values()]
