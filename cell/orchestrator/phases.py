"""What each state of a fold does."""

from collections.abc import Callable, Generator
from dataclasses import asdict, dataclass
from functools import partial

import numpy as np

from calibration.perception.measurement import SeenTouch
from calibration.perception.preflight import Preflight, inspect
from calibration.touched_points import TouchedPoints
from cell.orchestrator.context import CalibrationContext, Context, FoldContext, ManualContext
from cell.orchestrator.recorder import Record
from cell.orchestrator.snapshot import Command, Drive, Hold, Snapshot
from cell.orchestrator.states import Event, State
from cell.orchestrator.steps import Motion, Phase, close_hand, move, open_hand, pause, wait_for
from cell.orchestrator.vision import StripReader
from drivers.errors import Fault, PreflightRefused
from drivers.types import Frame, Pose, Velocity
from policies.follower import Follower
from policies.path import Path, lift_pitch
from policies.policy import Decision, Observation

SETTLE = 0.3  # s for strip and image to come to rest
PITCH_GAIN = 10.0  # 1/s, how fast an error of pitch is taken out
HANGING = np.pi / 2


@dataclass(frozen=True, slots=True)
class Pictured:
    """An image taken at rest: when it was looked at [s], and where the gripper stood."""

    time: float
    frame: Frame
    gripper: Pose


def preflight(cell: FoldContext, record: Record, _: Snapshot) -> Phase:
    """Judge the picture of the strip before it is touched."""
    fold = cell.settings.fold
    yield from move(Pose(cell.strip.length + fold.approach, fold.clear_height, 0.0))
    frame = (yield from _still_picture()).frame
    seen = inspect(frame, cell.calibration, cell.settings.perception, cell.strip)
    record.frame(frame)
    checks = [asdict(check) for check in seen.checks]
    record.event(frame.stamp, "preflight", checks=checks)
    record.describe(preflight=checks)
    if seen.appearance is None or not seen.passed:
        raise PreflightRefused(_failures(seen))
    cell.reader = StripReader.of(cell.settings, cell.strip, cell.calibration, seen.appearance)
    return Event.CHECKED


def go_calibrate(_cell: CalibrationContext, _record: Record, _begin: Snapshot) -> Phase:
    """A run that calibrates has no strip to judge."""
    yield from pause(0.0)
    return Event.NEEDS_CALIBRATION


def calibrate(cell: CalibrationContext, record: Record, _: Snapshot) -> Phase:
    """The map to the plane, from points that the pointer touches."""
    points = TouchedPoints(cell.lens, cell.settings.touches)
    while (pose := points.ask()) is not None:
        yield from move(pose)
        picture = yield from _still_picture()
        refused = points.tell(picture.frame, picture.gripper)
        if refused is not None:
            record.event(picture.time, "touch_refused", reason=refused)
    cell.touches = points.verdict()
    return Event.CALIBRATED


def grasp(cell: FoldContext, _record: Record, _begin: Snapshot) -> Phase:
    """Come from beyond the free edge, close the fingers on it, check that they hold it."""
    length = cell.strip.length
    approach = cell.settings.fold.approach
    yield from open_hand()
    yield from move(Pose(length + approach, 2 * approach, 0.0))
    yield from move(Pose(length + approach, 0.0, 0.0))
    yield from move(Pose(length, 0.0, 0.0))
    snapshot = yield from close_hand()
    if not snapshot.hand.grasped:
        raise Fault("grasp_missed", "the fingers closed on nothing; lay the edge at x = L")
    yield from pause(SETTLE)
    return Event.GRASPED


def lift(cell: FoldContext, _record: Record, _begin: Snapshot) -> Phase:
    """Follow the first stretch of the policy's own path while the pitch grows to hanging."""
    speed = cell.settings.fold.speed
    cell.policy.reset(cell.strip, speed, 1)
    follower = Follower(cell.policy.lift(), 1)
    snapshot = yield Drive(Velocity(0.0, 0.0, 0.0))
    while snapshot.arm.pose.z < cell.settings.fold.takeover_height:
        pose = snapshot.arm.pose
        decision = follower.decide(np.array([pose.x]), np.array([pose.z]), speed)
        if decision.done[0]:
            return Event.PATH_DONE
        travel = float(follower.progress[0])
        snapshot = yield Drive(_velocity(decision, _lift_pitch_rate(travel, speed, pose.pitch)))
    return Event.LIFTED


def fold(cell: FoldContext, record: Record, begin: Snapshot) -> Phase:
    """Decide on each new frame, command on each tick, until the layers are seen to touch."""
    command = Drive(begin.velocity)
    while True:
        snapshot = yield command
        if not snapshot.view.fresh or snapshot.view.measurement is None:
            continue
        if snapshot.view.touch is not None:
            cell.seen_touch = snapshot.view.touch
            return Event.LAYER_TOUCH
        decision = cell.policy.decide(observe(snapshot))
        record.decision(snapshot, decision)
        if decision.done[0]:
            return Event.PATH_DONE
        upright = PITCH_GAIN * (HANGING - snapshot.arm.pose.pitch)
        command = Drive(_velocity(decision, float(decision.pitch_rate[0]) + upright))


def touched(cell: FoldContext, record: Record, _: Snapshot) -> Phase:
    """Brake, let the picture settle, and take the measure of the touch."""
    snapshot = yield from pause(cell.settings.fold.touch_settle)
    snapshot = yield from wait_for(lambda now: not now.arm.moving)
    cell.seen_touch = snapshot.view.touch or cell.seen_touch
    record.event(snapshot.time, "at_rest_after_touch", x=snapshot.arm.pose.x, z=snapshot.arm.pose.z)
    return Event.SETTLED


def lay(cell: FoldContext, record: Record, _: Snapshot) -> Phase:
    """Lower the grasped edge to the desk, without pulling at the touch."""
    snapshot = yield from pause(0.0)
    path = lay_path(_seen(cell), snapshot.arm.pose, cell.strip.thickness)
    snapshot = yield from _follow_lay(path, cell.settings.fold.lay_speed)
    record.event(snapshot.time, "laid", x=snapshot.arm.pose.x, z=snapshot.arm.pose.z)
    return Event.LAID


def release(cell: FoldContext, record: Record, _: Snapshot) -> Phase:
    """Open the fingers, see where the edges ended, and retreat from the strip."""
    snapshot = yield from open_hand()
    cell.edge_offset = -snapshot.arm.pose.x
    record.event(snapshot.time, "released", edge_offset=cell.edge_offset)
    retreat = cell.settings.fold.approach
    pose = snapshot.arm.pose
    yield from move(Pose(pose.x - retreat, pose.z, pose.pitch))
    yield from move(Pose(pose.x - retreat, pose.z + 2 * retreat, pose.pitch))
    return Event.RELEASED


def move_by_hand(context: ManualContext, _: Record, snapshot: Snapshot) -> Phase:
    """Do the one motion that was asked for."""
    yield from context.motion(snapshot)
    return Event.MOVED


PhaseFactory = Callable[[Record, Snapshot], Phase]
_FOLD: dict[State, Callable[[FoldContext, Record, Snapshot], Phase]] = {
    State.PREFLIGHT: preflight,
    State.GRASP: grasp,
    State.LIFT: lift,
    State.FOLD: fold,
    State.TOUCHED: touched,
    State.LAY: lay,
    State.RELEASE: release,
}
_CALIBRATION: dict[State, Callable[[CalibrationContext, Record, Snapshot], Phase]] = {
    State.PREFLIGHT: go_calibrate,
    State.CALIBRATE: calibrate,
}


def phases_of(context: Context) -> dict[State, PhaseFactory]:
    """The phases of a run with this context; each starts from the snapshot that led to it."""
    if isinstance(context, CalibrationContext):
        return {state: partial(phase, context) for state, phase in _CALIBRATION.items()}
    if isinstance(context, ManualContext):
        return {State.PREFLIGHT: partial(move_by_hand, context)}
    return {state: partial(phase, context) for state, phase in _FOLD.items()}


def observe(snapshot: Snapshot) -> Observation:
    """What the policy may know: the gripper now, the strip when the newest image was so."""
    seen, pose = snapshot.view.measurement, snapshot.arm.pose
    if seen is None:
        raise Fault("image_stale", "a policy was asked to decide without an image")
    return Observation(
        time=np.array([snapshot.time]),
        x=np.array([pose.x]),
        z=np.array([pose.z]),
        stamp=np.array([seen.stamp]),
        contact_x=np.array([seen.contact_x]),
        tip_x=np.array([seen.tip[0]]),
        tip_z=np.array([seen.tip[1]]),
    )


def lay_path(touch: SeenTouch, gripper: Pose, rest: float) -> Path:
    """From `gripper` straight to where the taut layer's edge would lie, `rest` [m] up.

    That is x = touch.x - l1. Straight, not along the circle about the touch: the circle starts
    sideways, pulls the single point of contact along and rolls soft folds by 15 to 40 mm.
    """
    start = (gripper.x, gripper.z)
    return Path.through(np.array([start, (touch.x - touch.to_grasped, rest)]))


def _follow_lay(path: Path, speed: float) -> Motion:
    """Follow the lay path, turning the pitch evenly from hanging to lying backward."""
    follower = Follower(path, 1)
    snapshot = yield Drive(Velocity(0.0, 0.0, 0.0))
    while True:
        pose = snapshot.arm.pose
        decision = follower.decide(np.array([pose.x]), np.array([pose.z]), speed)
        if decision.done[0]:
            break
        share = float(follower.progress[0]) / path.length
        wanted = HANGING + share * HANGING
        rate = HANGING * speed / path.length + PITCH_GAIN * (wanted - pose.pitch)
        snapshot = yield Drive(_velocity(decision, rate))
    end = path.points[-1]
    return (yield from move(Pose(float(end[0]), float(end[1]), np.pi)))


def _lift_pitch_rate(travel: float, speed: float, pitch: float) -> float:
    wanted = float(lift_pitch(travel))
    ahead = float(lift_pitch(travel + 0.01)) - wanted
    return ahead / 0.01 * speed + PITCH_GAIN * (wanted - pitch)


def _velocity(decision: Decision, pitch_rate: float) -> Velocity:
    phi, speed = float(decision.direction[0]), float(decision.speed[0])
    return Velocity(speed * np.cos(phi), speed * np.sin(phi), pitch_rate)


def _still_picture() -> Generator[Command, Snapshot, Pictured]:
    """Wait until arm, strip and picture are at rest; the first image taken after that."""
    still = (yield from pause(SETTLE)).time
    while True:
        snapshot = yield Hold()
        if (
            snapshot.view.fresh
            and snapshot.view.frame is not None
            and snapshot.view.frame.stamp > still
        ):
            return Pictured(snapshot.time, snapshot.view.frame, snapshot.arm.pose)


def _seen(cell: FoldContext) -> SeenTouch:
    if cell.seen_touch is None:
        raise Fault("illegal_event", "LAY was entered without a touch")
    return cell.seen_touch


def _failures(seen: Preflight) -> str:
    failed = [check for check in seen.checks if not check.passed]
    return "\n".join(f"{check.name}: {check.reason}; {check.remedy}" for check in failed)
