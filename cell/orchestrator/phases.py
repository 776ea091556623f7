"""What each state of a fold does."""

from collections.abc import Callable, Generator
from dataclasses import asdict, dataclass

import numpy as np

from calibration.perception.preflight import Preflight, inspect
from calibration.perception.sight import SeenTouch
from calibration.touched_points import TouchedPoints
from cell.orchestrator.context import Knowledge
from cell.orchestrator.recorder import Record
from cell.orchestrator.snapshot import Command, Drive, Hold, Senses
from cell.orchestrator.states import Event, State
from cell.orchestrator.steps import Motion, Phase, close_hand, move, open_hand, pause, wait_for
from drivers.errors import Fault, PreflightRefused
from drivers.types import Frame, Pose, Velocity
from policies.follower import Follower
from policies.path import Path, lift_pitch
from policies.policy import Decision, Observation
from policies.profile import seen_profile

SETTLE = 0.3  # s for strip and image to come to rest
PITCH_GAIN = 10.0  # 1/s, how fast an error of pitch is taken out
HANGING = np.pi / 2


@dataclass(frozen=True, slots=True)
class Pictured:
    """An image taken at rest: when it was looked at [s], and where the gripper stood."""

    time: float
    frame: Frame
    gripper: Pose


def preflight(cell: Knowledge, record: Record) -> Phase:
    """Judge the picture of the strip before it is touched; without a calibration, make one."""
    if cell.calibration is None:
        yield from pause(0.0)
        return Event.NEEDS_CALIBRATION
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
    cell.see_with(cell.calibration, seen.appearance)
    return Event.CHECKED


def calibrate(cell: Knowledge, record: Record) -> Phase:
    """The map to the plane, from points that the pointer touches."""
    if cell.lens is None:
        raise PreflightRefused("there is no calibration; run `cell calibrate`")
    points = TouchedPoints(cell.lens, cell.settings.touches)
    while (pose := points.ask()) is not None:
        yield from move(pose)
        picture = yield from _still_picture()
        refused = points.tell(picture.frame, picture.gripper)
        if refused is not None:
            record.event(picture.time, "touch_refused", reason=refused)
    cell.touches = points.verdict()
    return Event.CALIBRATED


def grasp(cell: Knowledge, _: Record) -> Phase:
    """Come from beyond the free edge, close the fingers on it, check that they hold it."""
    length = cell.strip.length
    approach = cell.settings.fold.approach
    yield from open_hand()
    yield from move(Pose(length + approach, 2 * approach, 0.0))
    yield from move(Pose(length + approach, 0.0, 0.0))
    yield from move(Pose(length, 0.0, 0.0))
    senses = yield from close_hand()
    if not senses.hand.grasped:
        raise Fault("grasp_missed", "the fingers closed on nothing; lay the edge at x = L")
    yield from pause(SETTLE)
    return Event.GRASPED


def lift(cell: Knowledge, _: Record) -> Phase:
    """Follow the first stretch of the policy's own path while the pitch grows to hanging."""
    speed = cell.settings.fold.speed
    cell.policy.reset(cell.strip, speed, 1)
    follower = Follower(cell.policy.lift(), 1)
    senses = yield Drive(Velocity(0.0, 0.0, 0.0))
    while senses.arm.pose.z < cell.settings.fold.takeover_height:
        pose = senses.arm.pose
        decision = follower.decide(np.array([pose.x]), np.array([pose.z]), speed)
        if decision.done[0]:
            return Event.PATH_DONE
        travel = float(follower.progress[0])
        senses = yield Drive(_velocity(decision, _lift_pitch_rate(travel, speed, pose.pitch)))
    return Event.LIFTED


def fold(cell: Knowledge, record: Record) -> Phase:
    """Decide on each new frame, command on each tick, until the layers are seen to touch."""
    command = Drive(cell.velocity)
    while True:
        senses = yield command
        if not senses.fresh or senses.sight is None:
            continue
        if senses.touch is not None:
            cell.seen_touch = senses.touch
            return Event.LAYER_TOUCH
        decision = cell.policy.decide(observe(senses))
        record.decision(senses, decision)
        if decision.done[0]:
            return Event.PATH_DONE
        upright = PITCH_GAIN * (HANGING - senses.arm.pose.pitch)
        command = Drive(_velocity(decision, float(decision.pitch_rate[0]) + upright))


def touched(cell: Knowledge, record: Record) -> Phase:
    """Brake, let the picture settle, and take the measure of the touch."""
    senses = yield from pause(cell.settings.fold.touch_settle)
    senses = yield from wait_for(lambda now: not now.arm.moving)
    cell.seen_touch = senses.touch or cell.seen_touch
    record.event(senses.time, "at_rest_after_touch", x=senses.arm.pose.x, z=senses.arm.pose.z)
    return Event.SETTLED


def lay(cell: Knowledge, record: Record) -> Phase:
    """Lower the grasped edge to the desk, without pulling at the touch."""
    senses = yield from pause(0.0)
    path = lay_path(_seen(cell), senses.arm.pose, cell.strip.thickness)
    senses = yield from _follow_lay(path, cell.settings.fold.lay_speed)
    record.event(senses.time, "laid", x=senses.arm.pose.x, z=senses.arm.pose.z)
    return Event.LAID


def release(cell: Knowledge, record: Record) -> Phase:
    """Open the fingers, see where the edges ended, and retreat from the strip."""
    senses = yield from open_hand()
    cell.edge_offset = -senses.arm.pose.x
    record.event(senses.time, "released", edge_offset=cell.edge_offset)
    retreat = cell.settings.fold.approach
    pose = senses.arm.pose
    yield from move(Pose(pose.x - retreat, pose.z, pose.pitch))
    yield from move(Pose(pose.x - retreat, pose.z + 2 * retreat, pose.pitch))
    return Event.RELEASED


PHASES: dict[State, Callable[[Knowledge, Record], Phase]] = {
    State.PREFLIGHT: preflight,
    State.CALIBRATE: calibrate,
    State.GRASP: grasp,
    State.LIFT: lift,
    State.FOLD: fold,
    State.TOUCHED: touched,
    State.LAY: lay,
    State.RELEASE: release,
}


def observe(senses: Senses) -> Observation:
    """What the policy may know: the gripper now, the strip when the newest image was so."""
    sight, pose = senses.sight, senses.arm.pose
    if sight is None:
        raise Fault("image_stale", "a policy was asked to decide without an image")
    return Observation(
        time=np.array([senses.time]),
        x=np.array([pose.x]),
        z=np.array([pose.z]),
        stamp=np.array([sight.stamp]),
        contact_x=np.array([sight.contact_x]),
        tip_x=np.array([sight.tip[0]]),
        tip_z=np.array([sight.tip[1]]),
        profile=seen_profile(sight.profile, sight.gripper),
        profile_confidence=np.array([sight.profile_confidence]),
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
    senses = yield Drive(Velocity(0.0, 0.0, 0.0))
    while True:
        pose = senses.arm.pose
        decision = follower.decide(np.array([pose.x]), np.array([pose.z]), speed)
        if decision.done[0]:
            break
        share = float(follower.progress[0]) / path.length
        wanted = HANGING + share * HANGING
        rate = HANGING * speed / path.length + PITCH_GAIN * (wanted - pose.pitch)
        senses = yield Drive(_velocity(decision, rate))
    end = path.points[-1]
    return (yield from move(Pose(float(end[0]), float(end[1]), np.pi)))


def _lift_pitch_rate(travel: float, speed: float, pitch: float) -> float:
    wanted = float(lift_pitch(travel))
    ahead = float(lift_pitch(travel + 0.01)) - wanted
    return ahead / 0.01 * speed + PITCH_GAIN * (wanted - pitch)


def _velocity(decision: Decision, pitch_rate: float) -> Velocity:
    phi, speed = float(decision.direction[0]), float(decision.speed[0])
    return Velocity(speed * np.cos(phi), speed * np.sin(phi), pitch_rate)


def _still_picture() -> Generator[Command, Senses, Pictured]:
    """Wait until arm, strip and picture are at rest; the first image taken after that."""
    still = (yield from pause(SETTLE)).time
    while True:
        senses = yield Hold()
        if senses.fresh and senses.frame is not None and senses.frame.stamp > still:
            return Pictured(senses.time, senses.frame, senses.arm.pose)


def _seen(cell: Knowledge) -> SeenTouch:
    if cell.seen_touch is None:
        raise Fault("illegal_event", "LAY was entered without a touch")
    return cell.seen_touch


def _failures(seen: Preflight) -> str:
    failed = [check for check in seen.checks if not check.passed]
    return "\n".join(f"{check.name}: {check.reason}; {check.remedy}" for check in failed)
