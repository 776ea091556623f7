import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from cell.base.config.settings import MonitorLimits
from cell.orchestrator.monitors import MONITORS, MOVED_IMAGES, Rules, check_all
from cell.orchestrator.snapshot import Drive, Hold, MoveTo, Snapshot
from cell.orchestrator.states import State
from drivers.base.errors import Fault
from drivers.base.installation import AxisLimits, MotionLimits, Workspace
from drivers.base.types import Pose, Velocity
from tests.support.plain_cell import ARM, FRAME, GOOD, HAND, POSE, of_arm, showing


def turned(by: float) -> Pose:
    return replace(POSE, pitch=POSE.pitch + by)


LIMITS = MonitorLimits()
RULES = Rules(LIMITS, Workspace())
MOVING = {State.GRASP, State.LIFT, State.FOLD, State.TOUCHED, State.LAY, State.RELEASE}
WATCHED = {
    "arm_pose_not_finite": MOVING | {State.PREFLIGHT, State.CALIBRATE},
    "arm_state_stale": MOVING | {State.PREFLIGHT, State.CALIBRATE},
    "hand_state_stale": MOVING | {State.PREFLIGHT, State.CALIBRATE},
    "setpoint_expired": {State.LIFT, State.FOLD, State.LAY},
    "overspeed": MOVING | {State.PREFLIGHT, State.CALIBRATE},
    "tracking_error": MOVING | {State.PREFLIGHT, State.CALIBRATE},
    "workspace": MOVING | {State.PREFLIGHT, State.CALIBRATE},
    "force": MOVING | {State.PREFLIGHT, State.CALIBRATE},
    "grip_lost": {State.LIFT, State.FOLD, State.TOUCHED, State.LAY},
    "image_stale": MOVING,
    "image_frozen": MOVING,
    "image_reader_dead": MOVING,
    "image_reading_overdue": MOVING,
    "camera_moved": {State.LIFT, State.FOLD},
    "strip_too_thick": {State.FOLD},
    "low_confidence": {State.LIFT, State.FOLD},
    "state_overtime": MOVING | {State.PREFLIGHT},
    "overtime": MOVING | {State.PREFLIGHT},
    "calibration_overtime": {State.CALIBRATE},
}


def test_nothing_trips_on_a_good_tick() -> None:
    check_all(GOOD, Drive(Velocity(-0.1, 0.0, 0.0)), RULES)


@pytest.mark.parametrize("side", [(-1, -1), (-1, 1), (1, -1), (1, 1)])
def test_arm_may_overshoot_its_workspace_by_the_border_alone(
    side: tuple[int, int],
) -> None:
    check = next(m.check for m in MONITORS if m.name == "workspace")
    corner = [RULES.workspace.x[side[0] > 0], RULES.workspace.z[side[1] > 0]]
    for share in (0.9, 1.1):
        x, z = corner + share * LIMITS.border * np.array(side)
        assert (check(of_arm(pose=Pose(x, z, 1.5)), RULES) is None) == (share < 1.0)


NOW, FASTEST = GOOD.time, LIMITS.speed * LIMITS.overspeed
AT_LIMIT: dict[str, tuple[float, Callable[[float], Snapshot]]] = {
    "arm_state_stale": (LIMITS.arm_age, lambda v: of_arm(stamp=NOW - v)),
    "hand_state_stale": (
        LIMITS.hand_age,
        lambda v: replace(GOOD, hand=replace(HAND, stamp=NOW - v)),
    ),
    "image_stale": (LIMITS.image_wait, lambda v: showing(stale_since=NOW - v)),
    "image_reading_overdue": (LIMITS.reading, lambda v: showing(reading_since=NOW - v)),
    "low_confidence": (LIMITS.doubt, lambda v: showing(doubtful_since=NOW - v)),
    "overspeed": (FASTEST, lambda v: of_arm(velocity=Velocity(0.6 * v, -0.8 * v, 0.0))),
    "tracking_error": (
        LIMITS.tracking_error,
        lambda v: of_arm(commanded=replace(POSE, x=POSE.x - 0.8 * v, z=0.2 + 0.6 * v)),
    ),
    "force": (LIMITS.force, lambda v: of_arm(force=(-0.6 * v, 0.8 * v))),
    "image_frozen": (LIMITS.identical_images, lambda v: showing(identical=round(v))),
    "camera_moved": (MOVED_IMAGES, lambda v: showing(moved=round(v))),
    "strip_too_thick": (0.0, lambda v: showing(resting=v)),
    "state_overtime": (LIMITS.state_duration, lambda v: replace(GOOD, entered=NOW - v)),
    "calibration_overtime": (
        LIMITS.calibration,
        lambda v: replace(GOOD, state=State.CALIBRATE, entered=NOW - v),
    ),
}


BROKEN = {
    "arm_pose_not_finite": of_arm(pose=Pose(math.nan, 0.2, 0.0)),
    "setpoint_expired": of_arm(expired=True),
    "workspace": of_arm(pose=Pose(0.4, -0.02, 1.5), commanded=POSE),
    "grip_lost": replace(GOOD, hand=replace(HAND, grasped=False)),
    "image_reader_dead": showing(reader_failure="the process for images has ended"),
    "overtime": replace(
        GOOD,
        time=121.0,
        entered=100.0,
        arm=replace(ARM, stamp=121.0),
        hand=replace(HAND, stamp=121.0),
        view=replace(GOOD.view, frame=replace(FRAME, stamp=121.0)),
    ),
    **{name: beyond(1.2 * limit + 1e-3) for name, (limit, beyond) in AT_LIMIT.items()},
}


@pytest.mark.parametrize("name", AT_LIMIT)
def test_monitor_stops_at_its_limit_and_not_before(name: str) -> None:
    limit, showing_value = AT_LIMIT[name]
    check = next(monitor.check for monitor in MONITORS if monitor.name == name)
    counted = isinstance(limit, int)
    within, beyond = (limit - 1, limit) if counted else (limit - 1e-3, limit + 1e-3)
    assert check(showing_value(within), RULES) is None
    assert check(showing_value(beyond), RULES) is not None


def test_every_monitor_has_a_case_here() -> None:
    assert {monitor.name for monitor in MONITORS} == set(BROKEN)


@pytest.mark.parametrize("name", BROKEN)
def test_monitor_stops_before_the_command(name: str) -> None:
    loose = (
        LIMITS.model_copy(update={"tracking_error": 1.0})
        if name == "workspace"
        else LIMITS
    )
    rules = replace(RULES, limits=loose)
    with pytest.raises(Fault) as stopped:
        check_all(BROKEN[name], Hold(), rules)
    assert stopped.value.name == name


@pytest.mark.parametrize(
    ("snapshot", "name"),
    [
        (
            of_arm(velocity=Velocity(0.0, 0.0, -3.3)),
            "overspeed",
        ),
        (
            of_arm(velocity=Velocity(0.0, 0.0, math.nan)),
            "overspeed",
        ),
        (of_arm(commanded=turned(0.2)), "tracking_error"),
        (of_arm(commanded=turned(-0.2)), "tracking_error"),
        *(
            (of_arm(pose=pose, commanded=pose), "workspace")
            for pose in (Pose(-0.2, 0.2, 1.5), Pose(0.9, 0.2, 1.5), Pose(0.4, 0.6, 1.5))
        ),
        # of the future
        (replace(GOOD, hand=replace(HAND, stamp=11.0)), "hand_state_stale"),
        (of_arm(stamp=10.5), "arm_state_stale"),
        (showing(frame=replace(FRAME, stamp=40.0)), "image_stale"),
    ],
)
def test_monitors_watch_every_direction(snapshot: Snapshot, name: str) -> None:
    with pytest.raises(Fault) as stopped:
        check_all(snapshot, Hold(), RULES)
    assert stopped.value.name == name


def test_pitch_has_a_limit_of_the_arm_s_motion_however_slow_that_is() -> None:
    assert RULES.tracking_turn == pytest.approx(0.015 * 2.6 / 0.2)
    check_all(of_arm(commanded=turned(0.19)), Hold(), RULES)
    slow = AxisLimits(velocity=0.001, acceleration=1.0, jerk=10.0)
    creeping = replace(RULES, motion=MotionLimits(x=slow, z=slow))
    assert creeping.tracking_turn == pytest.approx(0.015 * math.pi / 2 / 0.1)
    lazy = replace(RULES, motion=MotionLimits(pitch=slow))
    turning = of_arm(velocity=Velocity(0.0, 0.0, 0.01))
    check_all(turning, Hold(), RULES)
    with pytest.raises(Fault, match="turns at"):
        check_all(turning, Hold(), lazy)


def test_each_monitor_watches_in_its_states() -> None:
    """Those of the arm wherever it may move, those of images wherever they are relied
    on.
    """
    assert {monitor.name: set(monitor.states) for monitor in MONITORS} == WATCHED


@pytest.mark.parametrize(
    ("command", "name"),
    [
        (MoveTo(Pose(2.0, 0.1, 0.0)), "outside_workspace"),
        (Drive(Velocity(0.3, 0.3, 0.0)), "command_refused"),
    ],
)
def test_a_command_beyond_its_limits_is_refused(
    command: MoveTo | Drive, name: str
) -> None:
    with pytest.raises(Fault) as refused:
        check_all(GOOD, command, RULES)
    assert refused.value.name == name


def test_no_limit_can_be_switched_off() -> None:
    for name, field in MonitorLimits.model_fields.items():
        assert field.default is not None, name
        assert any(
            hasattr(rule, "le") or hasattr(rule, "lt") for rule in field.metadata
        ), name


@pytest.mark.parametrize(
    ("moving", "awaited"),
    [
        ({"arm": True}, "the arm, at x 400, z 200 mm and commanded to"),
        ({"hand": True}, "the fingers"),
        ({}, "an image and its reading"),
    ],
)
def test_state_that_lasts_too_long_says_what_it_waits_for(moving, awaited) -> None:
    late = replace(
        GOOD,
        entered=-60.0,
        arm=replace(ARM, pose=POSE, moving="arm" in moving),
        hand=replace(HAND, moving="hand" in moving),
    )
    with pytest.raises(Fault, match=f"allowed 60 s; it waits for {awaited}"):
        check_all(late, Hold(), RULES)
