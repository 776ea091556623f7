from collections.abc import Callable
from dataclasses import replace
from math import nan, pi

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

LIMITS, STANDS = MonitorLimits(), Hold()


def turned(by: float) -> Snapshot:
    return of_arm(commanded=replace(POSE, pitch=POSE.pitch + by))


def of_hand(**changes: object) -> Snapshot:
    return replace(GOOD, hand=replace(HAND, **changes))


def stopped_by(
    snapshot: Snapshot,
    command: MoveTo | Drive | Hold = STANDS,
    rules: Rules | None = None,
) -> str:
    """Name of the fault that a tick ends in."""
    with pytest.raises(Fault) as stopped:
        check_all(snapshot, command, rules or RULES)
    return stopped.value.name


RULES = Rules(LIMITS, Workspace())
CHECKS = {monitor.name: monitor.check for monitor in MONITORS}
FOLDING = {State.LIFT, State.FOLD}
MOVING = FOLDING | {State.GRASP, State.TOUCHED, State.LAY, State.RELEASE}
PREPARING = MOVING | {State.PREFLIGHT}
AWAKE = PREPARING | {State.CALIBRATE}
WATCHED = {
    "arm_pose_not_finite": AWAKE,
    "arm_state_stale": AWAKE,
    "hand_state_stale": AWAKE,
    "setpoint_expired": FOLDING | {State.LAY},
    "overspeed": AWAKE,
    "tracking_error": AWAKE,
    "workspace": AWAKE,
    "force": AWAKE,
    "grip_lost": FOLDING | {State.TOUCHED, State.LAY},
    "image_stale": MOVING,
    "image_frozen": MOVING,
    "image_reader_dead": MOVING,
    "image_reading_overdue": MOVING,
    "camera_moved": FOLDING,
    "strip_too_thick": {State.FOLD},
    "low_confidence": FOLDING,
    "state_overtime": PREPARING,
    "overtime": PREPARING,
    "calibration_overtime": {State.CALIBRATE},
}


def test_nothing_trips_on_a_good_tick() -> None:
    check_all(GOOD, Drive(Velocity(-0.1, 0.0, 0.0)), RULES)


@pytest.mark.parametrize("side", [(-1, -1), (-1, 1), (1, -1), (1, 1)])
def test_arm_may_overshoot_its_workspace_by_the_border_alone(
    side: tuple[int, int],
) -> None:
    check = CHECKS["workspace"]
    corner = [RULES.workspace.x[side[0] > 0], RULES.workspace.z[side[1] > 0]]
    for share in (0.9, 1.1):
        x, z = corner + share * LIMITS.border * np.array(side)
        assert (check(of_arm(pose=Pose(x, z, 1.5)), RULES) is None) == (share < 1.0)


NOW, FASTEST = GOOD.time, LIMITS.speed * LIMITS.overspeed
AT_LIMIT: dict[str, tuple[float, Callable[[float], Snapshot]]] = {
    "arm_state_stale": (LIMITS.arm_age, lambda v: of_arm(stamp=NOW - v)),
    "hand_state_stale": (
        LIMITS.hand_age,
        lambda v: of_hand(stamp=NOW - v),
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


LATE = 121.0  # s
BROKEN = {
    "arm_pose_not_finite": of_arm(pose=Pose(nan, 0.2, 0.0)),
    "setpoint_expired": of_arm(expired=True),
    "workspace": of_arm(pose=Pose(0.4, -0.02, 1.5), commanded=POSE),
    "grip_lost": of_hand(grasped=False),
    "image_reader_dead": showing(reader_failure="the process for images has ended"),
    "overtime": replace(
        GOOD,
        time=LATE,
        entered=100.0,
        arm=replace(ARM, stamp=LATE),
        hand=replace(HAND, stamp=LATE),
        view=replace(GOOD.view, frame=replace(FRAME, stamp=LATE)),
    ),
    **{name: beyond(1.2 * limit + 1e-3) for name, (limit, beyond) in AT_LIMIT.items()},
}


@pytest.mark.parametrize("name", AT_LIMIT)
def test_monitor_stops_at_its_limit_and_not_before(name: str) -> None:
    limit, showing_value = AT_LIMIT[name]
    check = CHECKS[name]
    counted = isinstance(limit, int)
    within, beyond = (limit - 1, limit) if counted else (limit - 1e-3, limit + 1e-3)
    assert check(showing_value(within), RULES) is None
    assert check(showing_value(beyond), RULES) is not None


def test_every_monitor_has_a_case_here() -> None:
    assert CHECKS.keys() == BROKEN.keys()


@pytest.mark.parametrize("name", BROKEN)
def test_monitor_stops_before_the_command(name: str) -> None:
    loose = (
        LIMITS.model_copy(update={"tracking_error": 1.0})
        if name == "workspace"
        else LIMITS
    )
    rules = replace(RULES, limits=loose)
    assert stopped_by(BROKEN[name], rules=rules) == name


@pytest.mark.parametrize(
    ("snapshot", "name"),
    [
        (
            of_arm(velocity=Velocity(0.0, 0.0, -3.3)),
            "overspeed",
        ),
        (
            of_arm(velocity=Velocity(0.0, 0.0, nan)),
            "overspeed",
        ),
        (turned(0.2), "tracking_error"),
        (turned(-0.2), "tracking_error"),
        *(
            (of_arm(pose=pose, commanded=pose), "workspace")
            for pose in (Pose(-0.2, 0.2, 1.5), Pose(0.9, 0.2, 1.5), Pose(0.4, 0.6, 1.5))
        ),
        # of the future
        (of_hand(stamp=11.0), "hand_state_stale"),
        (of_arm(stamp=10.5), "arm_state_stale"),
        (showing(frame=replace(FRAME, stamp=40.0)), "image_stale"),
    ],
)
def test_monitors_watch_every_direction(snapshot: Snapshot, name: str) -> None:
    assert stopped_by(snapshot) == name


def test_pitch_has_a_limit_of_the_arm_s_motion_however_slow_that_is() -> None:
    assert RULES.tracking_turn == pytest.approx(0.015 * 2.6 / 0.2)
    check_all(turned(0.19), STANDS, RULES)
    slow = AxisLimits(velocity=0.001, acceleration=1.0, jerk=10.0)
    creeping = replace(RULES, motion=MotionLimits(x=slow, z=slow))
    assert creeping.tracking_turn == pytest.approx(0.015 * pi / 2 / 0.1)
    lazy = replace(RULES, motion=MotionLimits(pitch=slow))
    turning = of_arm(velocity=Velocity(0.0, 0.0, 0.01))
    check_all(turning, STANDS, RULES)
    with pytest.raises(Fault, match="turns at"):
        check_all(turning, STANDS, lazy)


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
    assert stopped_by(GOOD, command) == name


def test_no_limit_can_be_switched_off() -> None:
    for name, field in MonitorLimits.model_fields.items():
        assert field.default is not None, name
        assert any(
            hasattr(rule, "le") or hasattr(rule, "lt") for rule in field.metadata
        ), name


@pytest.mark.parametrize(
    ("moving", "awaited"),
    [
        ("arm", "the arm, at x 400, z 200 mm and commanded to"),
        ("hand", "the fingers"),
        ("", "an image and its reading"),
    ],
)
def test_state_that_lasts_too_long_says_what_it_waits_for(moving, awaited) -> None:
    late = replace(
        GOOD,
        entered=-60.0,
        arm=replace(ARM, pose=POSE, moving=moving == "arm"),
        hand=replace(HAND, moving=moving == "hand"),
    )
    with pytest.raises(Fault, match=f"allowed 60 s; it waits for {awaited}"):
        check_all(late, STANDS, RULES)
