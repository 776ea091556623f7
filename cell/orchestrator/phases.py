"""Phases of a run: a generator for each state, which answers snapshots by commands."""

from collections import deque
from collections.abc import Generator
from dataclasses import asdict
from math import hypot, inf, nan, sqrt

import numpy as np

from cell.base.devices import fold_path
from cell.orchestrator import steps
from cell.orchestrator.context import FoldInputs, FoldLog, ManualInputs, ManualLog
from cell.orchestrator.recorder import Recorder
from cell.orchestrator.snapshot import Command, Drive, Hold, Snapshot
from cell.orchestrator.states import State, Trigger
from cell.perception.image_reader import ImageResult, ImageTask, Reader
from cell.perception.laid_fold import LaidWeights, Loop, edge_offset, laid_length
from cell.perception.length_checks import (
    LengthCheck,
    compare_grip,
    held_end_offset,
)
from cell.perception.perception import LENGTH_ERROR
from cell.perception.preflight import UNWATCHED, PreflightCheck, check_camera
from cell.perception.strip_measurement import StripMeasurement
from drivers.base.errors import Fault, PreflightRefused
from drivers.base.geometry import moving_average
from drivers.base.types import ZERO_VELOCITY, Array, Pose
from policies.follower import Follower
from policies.path import lift_pitch
from policies.policy import Decision, Observation, Policy, Predictor
from policies.profile import image_profile

TURN_GAIN = 10.0  # 1/s, how fast an error of pitch is taken out
# of the arm's pitch acceleration, to stop the rotation at the lift's end
BRAKING_SHARE = 0.7
SLOPE_TRAVEL = 0.01  # m of the lift over which its rotation per metre is measured
COMPARED_TIME = 0.5  # s of images over which a hanging strip's motion is measured
FEWEST_IMAGES = 5  # that must lie in COMPARED_TIME
AVERAGED_IMAGES = 3  # images in a running mean, in which their noise averages out
BRAKING = 0.5  # m/s^2, less than any arm's limit, towards the end of a lay
# m/s, least speed of a lay, so that braking by the distance left reaches its end
CREEP = 0.005
ALIGNED = 0.0003  # m, of an edge from its place, that no push is worth
TAUT = 0.002  # m by which a layer that has bowed up is pulled beyond flat
MOST_PULLS = 5  # of an edge that is pushed
REST_TRAVEL = 0.0005  # m that the profile's mean travels, below which a strip rests


def preflight(
    given: FoldInputs, log: FoldLog, record: Recorder, _: Snapshot
) -> steps.Phase:
    """Check the image of the strip before it is grasped; raises PreflightRefused."""
    camera_checks = yield from _camera_checks(given)
    yield from steps.move(
        fold_path.approach_poses(given.strip.length, given.settings.fold)[0]
    )
    picture = yield from steps.still_picture()
    strip_checks = yield from _inspect(given.reader, picture)
    record.frame(picture.frame)
    checks = (*camera_checks, *strip_checks)
    facts = [asdict(check) for check in checks]
    stamp = picture.frame.stamp
    record.event(stamp, "preflight", checks=facts)
    record.describe(preflight=facts)
    log.witnesses += [check.witness for check in checks if check.witness is not None]
    refused = [check.sentence() for check in checks if not check.passed]
    if refused:
        raise PreflightRefused("\n".join(refused))
    for check in checks:
        if check.name == UNWATCHED:
            log.warning = f"{check.reason}; {check.remedy}"
            record.event(stamp, "camera_unwatched", reason=log.warning)
    return Trigger.CHECKED


def _inspect(
    reader: Reader, picture: steps.StillPicture
) -> Generator[Command, Snapshot, tuple[PreflightCheck, ...]]:
    """Results of the preflight's checks of a `picture`; raises Fault
    `image_reader_dead` where the reader has failed.
    """
    reader.submit(ImageTask(picture.frame), picture.time)
    while not isinstance(checks := reader.result(), tuple):
        if reader.failure:
            raise Fault("image_reader_dead", reader.failure)
        yield Hold()
    return checks


def grasp(
    given: FoldInputs, _log: FoldLog, _record: Recorder, _begin: Snapshot
) -> steps.Phase:
    """Move to the strip's free edge from beyond it and grasp it; raises Fault where the
    fingers miss it.
    """
    yield from steps.open_hand()
    for pose in fold_path.approach_poses(given.strip.length, given.settings.fold)[1:]:
        yield from steps.move(pose)
    snapshot = yield from steps.close_hand()
    if not snapshot.hand.grasped:
        raise Fault(
            "grasp_missed", "the fingers closed on nothing; lay the edge at x = L"
        )
    yield from steps.pause(steps.SETTLE)
    return Trigger.GRASPED


def lift(
    given: FoldInputs, _log: FoldLog, record: Recorder, _begin: Snapshot
) -> steps.Phase:
    """Lift the grasped edge along the policy's path, pitching the gripper until it is
    upright.

    In a run that starts hanging the strip then comes to rest, and measured time begins.
    """
    stated = given.settings.fold
    speed = stated.speed
    given.policy.reset(given.strip, speed, 1)
    follower = Follower(given.policy.lift(), 1)
    acceleration = given.settings.installation.limits.pitch.acceleration
    snapshot = yield Drive(ZERO_VELOCITY)
    while snapshot.arm.pose.z < stated.takeover_height:
        pose = snapshot.arm.pose
        decision = follower.decide(np.array([pose.x]), np.array([pose.z]), speed)
        if decision.done[0]:
            return Trigger.PATH_DONE
        travel = float(follower.progress[0])
        rate = _lift_pitch_rate(travel, speed, pose.pitch, acceleration)
        snapshot = yield steps.drive(decision, rate)
    if stated.start == "hanging":
        snapshot = yield from wait_until_still(stated.longest_rest, record)
        record.begin(snapshot.time)
    return Trigger.LIFTED


def wait_until_still(longest: float, record: Recorder) -> steps.Motion:
    """Bring the gripper to rest, upright, and wait at most `longest` [s] until the
    strip rests.

    The event `hanging` says whether the strip came to rest, and how far it still moved
    [m].
    """
    snapshot = yield from steps.wait_for(lambda now: not now.arm.moving)
    commanded = snapshot.arm.commanded
    snapshot = yield from steps.move(Pose(commanded.x, commanded.z, fold_path.HANGING))
    start = snapshot.time
    swing = Swing()
    while not swing.still and snapshot.time - start < longest:
        snapshot = yield Hold()
        swing.add(snapshot, start)
    waited = snapshot.time - start
    record.event(
        snapshot.time, "hanging", waited=waited, still=swing.still, moved=swing.moved
    )
    return snapshot


class Swing:
    """Motion of a hanging strip: the distance [m] that the mean point of its profile
    moves within COMPARED_TIME.
    """

    def __init__(self) -> None:
        self.moved = nan
        self._means: deque[tuple[float, Array]] = deque()

    @property
    def still(self) -> bool:
        """Whether the strip has moved less than REST_TRAVEL over enough images."""
        return self.moved < REST_TRAVEL

    def add(self, snapshot: Snapshot, since: float) -> None:
        """Add the profile in `snapshot`, if new and imaged after `since` [s]."""
        kept = self._means
        measurement = _read_since(snapshot, since)
        if measurement is None:
            return
        seen = image_profile(
            measurement.profile, measurement.contact_x, measurement.gripper
        )
        mean = seen[0].mean(axis=0)
        if not np.isfinite(mean).all():
            return
        kept.append((measurement.stamp, mean))
        while kept[0][0] < measurement.stamp - COMPARED_TIME:
            kept.popleft()
        waited = measurement.stamp - since >= COMPARED_TIME
        enough = waited and len(kept) >= FEWEST_IMAGES
        self.moved = self._travel() if enough else nan

    def _travel(self) -> float:
        """Largest distance [m] between the moving average of the profile's mean point
        and its mean over all kept images.
        """
        means = np.array([mean for _, mean in self._means])
        offsets = moving_average(means, AVERAGED_IMAGES) - means.mean(axis=0)
        return float(np.linalg.norm(offsets, axis=1).max())


def fold(
    given: FoldInputs, log: FoldLog, record: Recorder, begin: Snapshot
) -> steps.Phase:
    """Command the policy's decision on each image, until the layers touch or the path
    ends.
    """
    command = Drive(begin.velocity)
    offsets: list[float] = []
    while True:
        snapshot = yield command
        measurement = _read_since(snapshot, record.origin)
        if measurement is None:
            continue
        offsets.append(held_end_offset(measurement))
        touch = snapshot.view.touch
        if touch is not None:
            log.seen_touch = touch
            log.witnesses += compare_grip(offsets, given.calibration.residual)
            log.check_displacement(touch, given.expected)
            return Trigger.LAYER_TOUCH
        decision = given.policy.decide(
            observation(snapshot.time, snapshot.arm.pose, measurement)
        )
        _record_decision(record, snapshot, measurement, decision)
        _record_prediction(given.policy, log, record, snapshot)
        if decision.done[0]:
            return Trigger.PATH_DONE
        command = steps.drive(decision, _upright(snapshot.arm.commanded))


def _read_since(snapshot: Snapshot, begin: float) -> StripMeasurement | None:
    """Strip measurement that became available in `snapshot`; None without a new one, or
    for an image older than `begin` [s].
    """
    seen = snapshot.view.measurement if snapshot.view.read else None
    return None if seen is None or seen.stamp < begin else seen


def _record_decision(
    record: Recorder,
    snapshot: Snapshot,
    measurement: StripMeasurement,
    decision: Decision,
) -> None:
    """Record the policy's `decision` on the newest `measurement`, for `cell replay`."""
    record.event(
        snapshot.time,
        "decision",
        sequence=measurement.sequence,
        x=snapshot.arm.pose.x,
        z=snapshot.arm.pose.z,
        time=snapshot.time - record.origin,
        direction=float(decision.direction[0]),
        done=bool(decision.done[0]),
    )


def _record_prediction(
    policy: Policy, log: FoldLog, record: Recorder, snapshot: Snapshot
) -> None:
    """Record the policy's prediction, and an event where the policy loses or regains
    reliable images.
    """
    if not isinstance(policy, Predictor):
        return
    was_blind = log.predicted is not None and log.predicted.blind
    predicted = policy.prediction()
    log.predicted = predicted
    if predicted is None:
        return
    record.event(snapshot.time, "foretold", **asdict(predicted))
    if predicted.blind and not was_blind:
        record.event(snapshot.time, "policy_blind", path="shifted")
    elif was_blind and not predicted.blind:
        record.event(snapshot.time, "policy_sees", path="its own")


def _continue_to_lay(
    _given: FoldInputs, _log: FoldLog, record: Recorder, begin: Snapshot
) -> steps.Phase:
    """Record the touch of the layers and begin to lay the strip at once, as a pause
    would let its bend move.
    """
    yield from ()
    record.event(begin.time, "touch_seen", x=begin.arm.pose.x, z=begin.arm.pose.z)
    return Trigger.SETTLED


def lay(
    given: FoldInputs, log: FoldLog, record: Recorder, begin: Snapshot
) -> steps.Phase:
    """Lower the grasped edge to the desk, and push it until the camera sees that its
    layers are equal.
    """
    plan = _lay_plan(given, log, begin.arm.commanded)
    snapshot = yield from follow_lay(plan, given.settings.fold.lay_speed, begin)
    snapshot = yield from _push(given, log, plan, record, snapshot)
    record.event(snapshot.time, "laid", x=snapshot.arm.pose.x, z=snapshot.arm.pose.z)
    return Trigger.LAID


def _lay_plan(given: FoldInputs, log: FoldLog, gripper: Pose) -> fold_path.LayPlan:
    """Plan for laying the edge from the pose of the `gripper`; raises Fault where no
    touch was seen.
    """
    touch = log.seen_touch
    if touch is None:
        raise Fault("illegal_event", "LAY was entered without a touch")
    thickness = given.strip.thickness
    layers = max(thickness, touch.distance) + thickness / 2.0
    taut, goal = fold_path.taut_edge(touch), given.goal + given.place
    return fold_path.lay_plan(gripper, taut, layers, goal, given.settings.fold)


def follow_lay(plan: fold_path.LayPlan, speed: float, begin: Snapshot) -> steps.Motion:
    """Follow the path of `plan` to rest at `speed` [m/s], with the hand upright.

    The gripper slows down in time: one that brakes at the end of the path only meets
    the desk. So does one that is steered by where a trailing arm is measured.
    """
    path = plan.path
    follower = Follower(path, 1)
    pace = speed
    snapshot = yield Drive(begin.velocity)
    while True:
        pose = snapshot.arm.commanded
        decision = follower.decide(np.array([pose.x]), np.array([pose.z]), pace)
        if decision.done[0]:
            return (yield from steps.move(plan.held()))
        snapshot = yield steps.drive(decision, _upright(pose))
        left = path.length - float(follower.progress[0])
        pace = min(speed, max(CREEP, sqrt(2 * BRAKING * left)))


def _upright(pose: Pose) -> float:
    """Pitch rate [rad/s] that turns a hand at `pose` back to its upright pitch."""
    return TURN_GAIN * (fold_path.HANGING - pose.pitch)


def _push(
    given: FoldInputs,
    log: FoldLog,
    plan: fold_path.LayPlan,
    record: Recorder,
    snapshot: Snapshot,
) -> steps.Motion:
    """Push the held edge along the desk until the upper layer, as the camera sees it,
    would end where it is to lie.

    The fold rolls on after the touch, so that the upper layer is too long; a push rolls
    it back while the layer lies flat. One that bows up passes little on: it is pulled
    flat, and pushed again, unless that draws the fold along: then a push comes less
    near. Nothing slides on release: friction holds what lies.
    """
    pushed, pulls, nearest = 0.0, 0, inf
    beyond = first = yield from _seen_beyond(given, plan, snapshot)
    while beyond > ALIGNED and pushed < fold_path.PUSH and pulls < MOST_PULLS:
        step = min(beyond, fold_path.PUSH - pushed)
        before = beyond
        pushed += step
        snapshot, beyond = yield from _held_at(given, plan, record, pushed)
        bow = step - (before - beyond)
        if beyond > nearest + ALIGNED:
            break
        nearest = beyond
        if beyond > ALIGNED and bow > step / 2:
            pulls += 1
            pushed -= bow + TAUT
            snapshot, beyond = yield from _held_at(given, plan, record, pushed)
    if beyond <= ALIGNED:  # else the layer still bows, as the arm's word tells
        log.bent = pushed - (first - beyond)
    return snapshot


def _held_at(
    given: FoldInputs, plan: fold_path.LayPlan, record: Recorder, pushed: float
) -> Generator[Command, Snapshot, tuple[Snapshot, float]]:
    """Move the held edge to `pushed` [m] beyond its laid position, and measure how far
    [m] beyond its goal it would then lie.
    """
    snapshot = yield from steps.move(plan.held(pushed))
    beyond = yield from _seen_beyond(given, plan, snapshot)
    record.event(snapshot.time, "pushed", by=pushed, beyond=beyond)
    return snapshot, beyond


def _seen_beyond(
    given: FoldInputs, plan: fold_path.LayPlan, held: Snapshot
) -> Generator[Command, Snapshot, float]:
    """Distance [m] beyond its goal at which the edge would lie if the hand let go now;
    NaN where the camera sees no bend of the fold.
    """
    seen = yield from _lying_strip(given.reader, held.arm.pose)
    loop = None if seen is None else Loop.seen_in(seen)
    if loop is None:
        return nan
    return plan.end + edge_offset(given.strip.length, given.strip.thickness, loop)


def release(
    given: FoldInputs, log: FoldLog, record: Recorder, _: Snapshot
) -> steps.Phase:
    """Let go of the edge, retreat from the strip, and measure the offset of its
    edges.
    """
    thickness = given.strip.thickness
    snapshot = yield from steps.open_hand(thickness + fold_path.LOOSE)
    held = snapshot.arm.pose
    end = held.x - log.bent - fold_path.BEND
    edge = Pose(end, thickness, np.pi)  # once it lies flat
    record.event(snapshot.time, "released", edge_offset=given.goal - edge.x)
    yield from steps.move(fold_path.retreat(held, given.settings.fold))
    measurement = yield from _lying_strip(given.reader, edge)
    loop = _visible_loop(given.strip.length, measurement)
    log.released = True
    facts = {}
    if loop is not None:
        facts["loop"] = loop._asdict()
        _compare_edges(given, log, loop, edge)
    record.event(snapshot.time, "edges_seen", edge_offset=log.edge_offset, **facts)
    return Trigger.RELEASED


def _compare_edges(given: FoldInputs, log: FoldLog, loop: Loop, edge: Pose) -> None:
    """Record how far the laid edges lie apart by the image's `loop`, and check it
    against where the arm laid the `edge`.
    """
    beyond = edge_offset(given.strip.length, given.strip.thickness, loop)
    log.edge_offset = beyond + given.goal
    by_map = 2.0 * given.calibration.residual
    spread = hypot(by_map, LaidWeights.shipped().rms, fold_path.BENDING)
    log.witnesses.append(LengthCheck("edges", beyond + edge.x, spread))


def _lying_strip(
    reader: Reader, end: Pose
) -> Generator[Command, Snapshot, StripMeasurement | None]:
    """Measurement of the folded strip, with its upper edge at `end`, in a new image at
    rest; None where it cannot be measured.
    """
    picture = yield from steps.still_picture()
    task = ImageTask(picture.frame, end, hand=picture.gripper)
    reader.submit(task, picture.frame.arrival)
    result = reader.result()
    if isinstance(result, ImageResult):
        return result.measurement
    return (yield from steps.wait_for(lambda now: now.view.read)).view.measurement


def _visible_loop(length: float, measurement: StripMeasurement | None) -> Loop | None:
    """Bend (loop) of the laid strip; None where the image shows no fold of a strip of
    `length` [m].
    """
    if measurement is None:
        return None
    off = abs(laid_length(measurement) - length)
    return None if off > 2.0 * LENGTH_ERROR else Loop.seen_in(measurement)  # two layers


def move_manually(
    given: ManualInputs, log: ManualLog, _: Recorder, snapshot: Snapshot
) -> steps.Phase:
    """Carry out the motion of a manual run, and log the gripper's final pose."""
    log.end = (yield from given.motion(snapshot)).arm.pose
    return Trigger.MOVED


FOLD_PHASES = {
    State.PREFLIGHT: preflight,
    State.GRASP: grasp,
    State.LIFT: lift,
    State.FOLD: fold,
    State.TOUCHED: _continue_to_lay,
    State.LAY: lay,
    State.RELEASE: release,
}
MANUAL_PHASES = {State.PREFLIGHT: move_manually}


def observation(time: float, gripper: Pose, seen: StripMeasurement) -> Observation:
    """Observation for the policy at `time` [s]: the pose of the `gripper`, and the
    strip as measured in `seen`.
    """
    return Observation(
        time=np.array([time]),
        x=np.array([gripper.x]),
        z=np.array([gripper.z]),
        stamp=np.array([seen.stamp]),
        contact_x=np.array([seen.contact_x]),
        tip_x=np.array([seen.tip[0]]),
        tip_z=np.array([seen.tip[1]]),
        profile=image_profile(seen.profile, seen.contact_x, seen.gripper),
        profile_confidence=np.array([seen.profile_confidence]),
    )


def _lift_pitch_rate(
    travel: float, speed: float, pitch: float, acceleration: float
) -> float:
    """Pitch rate [rad/s] that follows the lift's pitch over `travel` [m] and comes to
    rest upright.

    It brakes in time for an arm whose pitch accelerates at `acceleration` [rad/s^2] at
    most.
    """
    target = float(lift_pitch(travel))
    slope = (float(lift_pitch(travel + SLOPE_TRAVEL)) - target) / SLOPE_TRAVEL  # rad/m
    rate = slope * speed + TURN_GAIN * (target - pitch)
    left = max(fold_path.HANGING - pitch, 0.0)
    return min(rate, sqrt(2.0 * BRAKING_SHARE * acceleration * left))


def _camera_checks(
    given: FoldInputs,
) -> Generator[Command, Snapshot, tuple[PreflightCheck, ...]]:
    """Check that the camera has not moved since its calibration; return no checks where
    no landmarks are known.
    """
    calibration = given.calibration
    landmarks = calibration.landmarks
    if landmarks is None:
        return ()
    yield from steps.open_hand()
    start = yield from steps.rotate_hand(landmarks.pitch)
    yield from steps.move(landmarks.pose)
    frame = (yield from steps.still_picture()).frame
    yield from steps.move(Pose(start.x, start.z, landmarks.pitch))
    yield from steps.move(start)
    check = check_camera(
        frame.image, landmarks, calibration, given.strip, given.settings.landmarks
    )
    return (check,)
