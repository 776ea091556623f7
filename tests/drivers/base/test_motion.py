"""Commanded motion: limits, workspace, expiry."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from cell.base.config.settings import MonitorLimits
from drivers.base.errors import ConfigurationError
from drivers.base.installation import AxisLimits, MotionLimits, Workspace
from drivers.base.motion import TICK, MotionProfile
from drivers.base.settings import parse
from drivers.base.types import ZERO_VELOCITY, Pose, Velocity

FAST = AxisLimits(velocity=0.5, acceleration=4.0, jerk=100.0)
LIMITS = MotionLimits(x=FAST, z=FAST)
BOX = Workspace(x=(0.0, 0.6), z=(0.0, 0.4), pitch=(0.0, 3.0))
MIDDLE = Pose(0.3, 0.2, 1.0)
FASTEST = np.array([axis.velocity for axis in LIMITS.axes])
HARDEST = np.array([axis.acceleration for axis in LIMITS.axes])
SHARPEST = np.array([axis.jerk for axis in LIMITS.axes])


def profile_at(start: Pose = MIDDLE) -> MotionProfile:
    return MotionProfile(LIMITS, BOX, start)


def state(profile: MotionProfile) -> np.ndarray:
    """(3, 3): position, velocity, acceleration over x, z, pitch."""
    pose, rate, push = profile.pose, profile.velocity, profile.acceleration
    return np.array(
        [
            [*pose],
            [*rate],
            [*push],
        ]
    )


def ticks(
    profile: MotionProfile, count: int, wish: Velocity | None = None
) -> np.ndarray:
    """States (count, 3, 3) of the next ticks, with `wish` refreshed at 100 Hz."""
    states = []
    for tick in range(count):
        if wish is not None and tick % 10 == 0:
            profile.set_velocity(wish)
        profile.tick()
        states.append(state(profile))
    return np.array(states)


def assert_within_limits(before: np.ndarray, states: np.ndarray) -> None:
    whole = np.concatenate([before[None], states])
    jerk = np.diff(whole[:, 2], axis=0) / TICK
    assert (np.abs(states[:, 1]) <= FASTEST * (1 + 1e-9) + 1e-12).all()
    assert (np.abs(states[:, 2]) <= HARDEST * (1 + 1e-9)).all()
    assert (np.abs(jerk) <= SHARPEST * (1 + 1e-6)).all()
    mean_rate = 0.5 * (whole[1:, 1] + whole[:-1, 1])
    assert np.diff(whole[:, 0], axis=0) / TICK == pytest.approx(mean_rate, abs=2e-4)


rates = st.tuples(*(st.floats(-top, top) for top in FASTEST)).map(
    lambda r: Velocity(*r)
)
places = st.tuples(*(st.floats(a, b) for a, b in zip(BOX.low, BOX.high, strict=True)))
orders = st.one_of(rates, rates, places.map(lambda p: Pose(*p)), st.just(None))


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.lists(st.tuples(orders, st.integers(2, 140)), min_size=1, max_size=12))
def test_no_sequence_of_orders_breaks_a_limit_or_leaves_the_workspace(sequence) -> None:
    profile = profile_at()
    for order, count in sequence:
        match order:
            case Velocity():
                profile.set_velocity(order)
            case Pose():
                profile.move_to(order)
            case None:
                profile.stop()
        before = state(profile)
        states = ticks(profile, count)
        assert_within_limits(before, states)
        assert (states[:, 0] >= np.array(BOX.low) - 1e-6).all()
        assert (states[:, 0] <= np.array(BOX.high) + 1e-6).all()


def test_move_from_rest_is_a_straight_line_that_ends_exactly_at_rest() -> None:
    profile, goal = profile_at(), Pose(0.1, 0.35, 2.0)
    profile.move_to(goal)
    assert profile.moving
    states = ticks(profile, 2000)
    start, end = MIDDLE.as_array(), goal.as_array()
    share = (states[:, 0] - start) / (end - start)
    assert share == pytest.approx(np.broadcast_to(share[:, :1], share.shape), abs=1e-9)
    assert profile.pose == goal
    assert profile.velocity == ZERO_VELOCITY
    assert not profile.moving


def test_lift_at_the_speed_of_a_fold_stays_on_its_line_and_a_move_ahead_does_not_stop_it():
    profile = profile_at(Pose(0.5, 0.1, 0.1))
    states = ticks(profile, 400, Velocity(-0.08, 0.06, np.pi / 2))
    way = states[:, 0] - [0.5, 0.1, 0.1]
    travel = np.hypot(way[:, 0], way[:, 1])
    assert np.abs(0.6 * way[:, 0] + 0.8 * way[:, 1]).max() < 1e-6
    assert np.abs(way[:, 2] - np.pi / 2 * travel / 0.1).max() < 1e-5
    profile.move_to(Pose(0.3, 0.25, 2.0))
    assert ticks(profile, 300)[:, 1, 0].max() < -0.07


SLOW = AxisLimits(velocity=0.1, acceleration=0.41, jerk=53.4)
SHARP = AxisLimits(velocity=0.22, acceleration=1.83, jerk=5.5)


@pytest.mark.parametrize(
    ("limits", "order"),
    [
        (LIMITS.model_copy(update={"z": SLOW}), Velocity(0.046, 0.009, -0.044)),
        (LIMITS.model_copy(update={"z": SHARP}), Pose(0.1, 0.16, 0.33)),
    ],
)
def test_path_stays_straight_where_one_axis_is_slower(limits, order) -> None:
    profile = MotionProfile(limits, BOX, MIDDLE)
    follow = profile.set_velocity if isinstance(order, Velocity) else profile.move_to
    follow(order)
    way = ticks(profile, 90 if isinstance(order, Velocity) else 4000)[:, 0]
    way -= MIDDLE.as_array()
    line = way[-1] / np.linalg.norm(way[-1])
    assert np.abs(way - np.outer(way @ line, line)).max() < 1e-9


@pytest.mark.parametrize(("axis", "sign"), [(a, s) for a in range(3) for s in (-1, 1)])
def test_velocity_out_of_the_workspace_is_braked_before_the_border(
    axis: int, sign: int
) -> None:
    rate = np.zeros(3)
    rate[axis] = sign * FASTEST[axis]
    states = ticks(profile_at(), 3000, Velocity(*rate))
    border = (BOX.low if sign < 0 else BOX.high)[axis]
    assert states[-1, 0, axis] == pytest.approx(border, abs=1e-3)
    assert ((states[:, 0, axis] - border) * sign <= 1e-9).all()
    assert states[-1, 1] == pytest.approx(np.zeros(3), abs=1e-3)


def test_at_a_border_the_other_axes_go_on() -> None:
    states = ticks(profile_at(), 1500, Velocity(-0.05, 0.3, 0.0))
    assert states[-1, 0, 1] == pytest.approx(BOX.z[1], abs=1e-3)
    assert states[-1, 1, 0] == pytest.approx(-0.05)


def test_arm_outside_its_workspace_can_come_back_and_go_no_further() -> None:
    outside = Pose(0.3, -0.05, 1.0)
    profile = profile_at(outside)
    further = ticks(profile, 300, Velocity(0.0, -0.1, 0.0))
    assert further[:, 0, 1].min() > -0.0505
    back = ticks(profile, 1000, Velocity(0.0, 0.1, 0.0))
    assert back[-1, 0, 1] > 0.03
    again = profile_at(outside)
    again.move_to(MIDDLE)
    ticks(again, 2000)
    assert again.pose == MIDDLE


@pytest.mark.parametrize("stopped", [False, True])
def test_move_that_would_swing_out_waits_for_the_brake_and_is_forgotten_by_a_stop(
    stopped: bool,
) -> None:
    profile, goal = profile_at(Pose(0.6, 0.1, 0.5)), Pose(0.6, 0.2, 2.4)
    profile.move_to(Pose(0.5, 0.4, 1.9))
    ticks(profile, 50)
    profile.move_to(goal)
    if stopped:
        profile.stop()
    states = ticks(profile, 2000)
    assert states[:, 0, 0].max() <= BOX.x[1] + 1e-9
    assert not profile.moving
    assert (profile.pose == goal) != stopped


AXIS = {"velocity": 0.2, "acceleration": 4.0, "jerk": 100.0}


@pytest.mark.parametrize(
    ("model", "content", "reason"),
    [
        (AxisLimits, {"velocity": 0.2, "acceleration": 4.0}, "jerk: is missing"),
        *(
            (AxisLimits, AXIS | {name: value}, f"cell.yaml: {name}: is")
            for name in AXIS
            for value in (0.0, 1e9, None)
        ),
        (Workspace, {"x": [0.5, 0.5]}, "x: needs low < high"),
        (Workspace, {"x": [-1e9, 1e9]}, "x"),
        (Workspace, {"z": [-0.5, 0.5]}, "z"),
        (Workspace, {"z": None}, "z"),
        (Workspace, {"pitch": [-100.0, 100.0]}, "pitch"),
    ],
)
def test_no_limit_can_be_left_out_or_set_so_wide_that_it_limits_nothing(
    model, content: dict, reason: str
) -> None:
    with pytest.raises(ConfigurationError, match=reason):
        parse(content, model, "cell.yaml")


def test_a_cell_file_that_states_no_limits_moves_below_what_monitors_allow() -> None:
    limits, watched = MotionLimits(), MonitorLimits()
    diagonal = np.hypot(limits.x.velocity, limits.z.velocity)
    assert diagonal < watched.speed * watched.overspeed
