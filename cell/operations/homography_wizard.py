"""`cell calibrate homography`: the arm touches points, the map to the plane is fitted and kept."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from calibration.calibration import Calibration, calibrated, save_calibration
from calibration.landmarks import Landmarks
from calibration.lens import CameraFile, Lens
from calibration.touched_points import touch_plan
from calibration.wizard.latency import LatencyVerdict
from calibration.wizard.news import TouchNews, ViewNews, Watcher
from calibration.wizard.note import Note
from calibration.wizard.picture import touches_picture
from calibration.wizard.session import (
    PICTURE,
    VERDICT,
    Session,
    SessionFolder,
    write_image,
    write_yaml,
)
from calibration.wizard.touch_verdict import TouchVerdict
from calibration.wizard.words import refusals, touch_lines
from cell.config.cell import CellFile
from cell.devices.devices import Devices
from cell.operations.interrupt import Interrupted
from cell.orchestrator.context import CalibrationContext
from cell.orchestrator.operator import Operator
from cell.orchestrator.recorder import NullRecorder
from cell.orchestrator.run import Run
from drivers.errors import CellError, Fault
from drivers.settings import Settings, load
from drivers.types import Pose

CALIBRATION, POSES, LANDMARKS = "calibration.yaml", "poses.yaml", "landmarks.yaml"


class PosesFile(Settings):
    """Contents of poses.yaml: x, z [m] and pitch [rad] of every touch, for editing and replay."""

    poses: tuple[tuple[float, float, float], ...]


@dataclass(frozen=True, slots=True)
class TouchSession:
    """Result of a session of touches; `calibration` is None where it was not accepted."""

    folder: Path
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
    """Touch, step and measure under the orchestrator's monitors; keep everything in `folder`.

    Raises Fault when a monitor stopped the arm and Interrupted when the operator did; the data
    until then stay in `folder`.
    """
    keep = SessionFolder(folder, _session(settings, devices, lens))
    note = Note(keep)
    poses = tuple(plan) if plan is not None else touch_plan(settings.touches)
    write_yaml(folder / POSES, {"poses": [[p.x, p.z, p.pitch] for p in poses]})

    newest: list[TouchNews] = []

    def both(news: ViewNews | TouchNews) -> None:
        note(news)
        watch(news)
        if isinstance(news, TouchNews) and news.frame is not None:
            newest[:] = [news]

    context = CalibrationContext(
        settings.controller, lens, operator=operator, watch=both, plan=poses, remembers=True
    )
    touch(devices, context, interrupted)
    made = _accepted(context, devices, accept_anyway=accept_anyway)
    keep_verdict(folder, context.touches, context.latency, made, settings.fold.speed)
    if context.landmarks is not None:
        write_yaml(folder / LANDMARKS, context.landmarks.model_dump(mode="json"))
    _draw(folder, newest, lens, context.touches)
    return TouchSession(folder, context.touches, context.latency, made)


def touch(devices: Devices, context: CalibrationContext, interrupted: Callable[[], bool]) -> None:
    """Run the calibration of `context`; raises Interrupted and Fault where it was stopped."""
    try:
        devices.connect()
        outcome = Run(devices, context, NullRecorder(), interrupted=interrupted).execute()
    finally:
        devices.close()
    if outcome.exit_code == Interrupted.exit_code:
        raise Interrupted(f"calibration was {outcome.name}: {outcome.reason}")
    if outcome.exit_code != 0 or (context.touches is None and context.check is None):
        raise Fault(outcome.name, f"calibration was stopped: {outcome.reason}")


def assembled(
    lens: Lens,
    touches: TouchVerdict | None,
    latency: LatencyVerdict | None,
    *,
    camera: str,
    locks: dict[str, int] | None = None,
    landmarks: Landmarks | None = None,
    accept_anyway: bool = False,
) -> Calibration:
    """A calibration from these parts; defects are a CellError, or recorded when overridden."""
    reasons = refusals(touches, latency)
    if touches is None or touches.homography is None or (reasons and not accept_anyway):
        raise CellError("homography failed: " + "; ".join(reasons))
    measured = latency is not None and latency.latency == latency.latency
    return calibrated(
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


def keep_verdict(
    folder: Path,
    touches: TouchVerdict | None,
    latency: LatencyVerdict | None,
    made: Calibration | None,
    speed: float,
) -> None:
    """Write the verdict, and the calibration where it was accepted."""
    content = {
        "accepted": made is not None,
        "calibration": None if made is None else made.id,
        "lines": [line.text for line in touch_lines(touches, latency, speed)],
        "errors_mm": {} if touches is None else {str(n): e for n, e in touches.errors_mm.items()},
    }
    write_yaml(folder / VERDICT, content)
    if made is not None:
        save_calibration(made, folder / CALIBRATION)


def read_poses(path: Path) -> tuple[Pose, ...]:
    """The poses of an edited poses.yaml; a broken file is a ConfigurationError."""
    return tuple(Pose(x, z, pitch) for x, z, pitch in load(path, PosesFile).poses)


def _accepted(
    context: CalibrationContext, devices: Devices, *, accept_anyway: bool
) -> Calibration | None:
    try:
        return assembled(
            context.lens,
            context.touches,
            context.latency,
            camera=devices.camera_identity,
            locks=dict(devices.camera_locks()),
            landmarks=context.landmarks,
            accept_anyway=accept_anyway,
        )
    except CellError:
        return None


def _draw(
    folder: Path, newest: Sequence[TouchNews], lens: Lens, verdict: TouchVerdict | None
) -> None:
    """Draw all points over the newest image, where there is one."""
    if newest and newest[-1].frame is not None and verdict is not None:
        last = newest[-1]
        image = touches_picture(newest[-1].frame.image, last.touches, lens, verdict)
        write_image(folder / PICTURE, image)


def _session(settings: CellFile, devices: Devices, lens: Lens) -> Session:
    return Session(
        schema=1,
        kind="homography",
        date=datetime.now(UTC).isoformat(timespec="seconds"),
        camera=devices.camera_identity,
        image=(lens.width, lens.height),
        locks=dict(devices.camera_locks()),
        lens=CameraFile.of(lens, devices.camera_identity),
        touches=settings.touches,
        latency=settings.latency,
    )
