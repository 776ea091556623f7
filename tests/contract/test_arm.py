"""What every arm must do, simulated or real."""

import math
from collections.abc import Callable
from itertools import pairwise

import pytest

from drivers.base.errors import Fault
from drivers.base.types import ZERO_VELOCITY, ArmState, Pose, Velocity

CONTROL = 0.01  # s


def wait(bench, seconds: float) -> ArmState:
    bench.clock.wait_until(bench.clock.now() + seconds)
    return bench.arm.state()


def drive(bench, velocity: Velocity, seconds: float) -> ArmState:
    for _ in range(round(seconds / CONTROL)):
        bench.arm.set_velocity(velocity)
        wait(bench, CONTROL)
    return bench.arm.state()


def until_rest(bench, limit: float = 10.0) -> ArmState:
    end = bench.clock.now() + limit
    while bench.clock.now() < end:
        state = wait(bench, CONTROL)
        if not state.moving:
            return state
    pytest.fail(f"the arm still moves after {limit} s")


def near(pose: Pose, other: Pose, tolerance: float) -> bool:
    return bool(abs(pose.as_array() - other.as_array()).max() <= tolerance)


@pytest.fixture
def arm(bench):
    bench.arm.connect()
    return bench.arm


def test_arm_that_is_not_connected_may_be_stopped_and_refuses_all_else(bench) -> None:
    bench.arm.stop()
    for command in _commands(bench.arm):
        with pytest.raises(Fault):
            command()


def test_arm_is_taken_over_at_rest(bench, arm) -> None:
    state = wait(bench, 0.05)
    assert not state.moving
    assert not state.expired
    assert state.velocity.speed < 1e-3
    assert near(state.pose, state.commanded, bench.accuracy)


def test_connecting_twice_is_allowed(bench, arm) -> None:
    arm.connect()
    assert not arm.state().moving


def test_states_are_fresh_and_never_stamped_after_their_arrival(bench, arm) -> None:
    stamps = []
    for _ in range(20):
        state = wait(bench, CONTROL)
        assert state.stamp <= state.arrival <= bench.clock.now()
        assert bench.clock.now() - state.stamp < 0.02
        assert state.source
        stamps.append(state.stamp)
    assert all(a < b for a, b in pairwise(stamps))


def test_reading_twice_at_one_instant_reads_the_same(bench, arm) -> None:
    first, second = arm.state(), arm.state()
    assert first.pose == second.pose or first.stamp < second.stamp


def test_move_returns_at_once_and_ends_at_rest_on_its_pose(bench, arm) -> None:
    start = arm.state()
    goal = Pose(start.pose.x - 0.05, start.pose.z + 0.03, start.pose.pitch + 0.2)
    arm.move_to(goal)
    assert arm.state().moving
    assert near(arm.state().pose, start.pose, 1e-3)
    state = until_rest(bench)
    assert near(state.pose, goal, bench.accuracy)
    assert near(state.commanded, goal, 1e-6)
    assert near(wait(bench, 0.2).pose, goal, bench.accuracy)


def test_move_to_where_the_arm_is_ends_at_once(bench, arm) -> None:
    arm.move_to(arm.state().commanded)
    assert not wait(bench, 0.03).moving


@pytest.mark.parametrize(
    "bad",
    [
        Pose(9.0, 0.1, 0.0),
        Pose(0.3, -5.0, 0.0),
        Pose(0.3, 0.1, 40.0),
        Pose(math.nan, 0, 0),
    ],
)
def test_pose_out_of_reach_is_refused_and_nothing_moves(bench, arm, bad) -> None:
    before = arm.state().commanded
    with pytest.raises(Fault, match=r"is out of reach; allowed: \S+ to \S+ "):
        arm.move_to(bad)
    assert not wait(bench, 0.1).moving
    assert near(arm.state().commanded, before, 1e-9)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("rate", [50.0, -50.0, math.nan])
def test_velocity_over_the_limit_is_refused_and_nothing_moves(
    bench, arm, axis, rate
) -> None:
    with pytest.raises(Fault, match=r"is over the limit; allowed: \S+ \S+ at most"):
        arm.set_velocity(
            Velocity(*(rate if here == axis else 0.0 for here in range(3)))
        )
    assert not wait(bench, 0.1).moving


def test_refused_order_leaves_a_motion_as_it_is(bench, arm) -> None:
    goal = Pose(arm.state().pose.x - 0.05, arm.state().pose.z, arm.state().pose.pitch)
    arm.move_to(goal)
    wait(bench, 0.05)
    with pytest.raises(Fault):
        arm.move_to(Pose(9.0, 0.0, 0.0))
    assert near(until_rest(bench).pose, goal, bench.accuracy)


def test_refreshed_velocity_is_followed(bench, arm) -> None:
    drive(bench, Velocity(-0.05, 0.02, 0.1), 0.3)
    before = arm.state()
    after = drive(bench, Velocity(-0.05, 0.02, 0.1), 0.5)
    assert after.moving
    assert not after.expired
    elapsed = after.stamp - before.stamp
    rates = (after.pose.as_array() - before.pose.as_array()) / elapsed
    assert rates == pytest.approx(
        [-0.05, 0.02, 0.1], abs=2 * bench.accuracy / elapsed + 1e-3
    )
    assert after.velocity.vx == pytest.approx(-0.05, abs=5e-3)


def test_velocity_holds_for_100_ms_and_then_the_arm_brakes_by_itself(
    bench, arm
) -> None:
    drive(bench, Velocity(-0.05, 0.0, 0.0), 0.3)
    arm.set_velocity(Velocity(-0.05, 0.0, 0.0))
    held = wait(bench, 0.09)
    assert not held.expired
    assert held.velocity.vx == pytest.approx(-0.05, abs=5e-3)
    expired = wait(bench, 0.03)
    assert expired.expired
    rested = until_rest(bench, limit=1.0)
    assert rested.expired
    assert rested.velocity.speed < 1e-3


def test_new_order_ends_the_state_of_expiry(bench, arm) -> None:
    wish, pose = Velocity(-0.05, 0.0, 0.0), arm.state().pose
    for order in (lambda: arm.set_velocity(wish), lambda: arm.move_to(pose), arm.stop):
        drive(bench, wish, 0.1)
        assert wait(bench, 0.3).expired
        order()
        assert not wait(bench, CONTROL).expired


def test_order_to_stand_still_does_not_expire(bench, arm) -> None:
    arm.set_velocity(ZERO_VELOCITY)
    state = wait(bench, 0.3)
    assert not state.expired
    assert not state.moving


def test_newer_order_replaces_a_move(bench, arm) -> None:
    start = arm.state().pose
    arm.move_to(Pose(start.x - 0.2, start.z, start.pitch))
    wait(bench, 0.1)
    goal = Pose(start.x, start.z + 0.05, start.pitch)
    arm.move_to(goal)
    assert near(until_rest(bench).pose, goal, bench.accuracy)


def test_stop_brakes_from_every_state(bench, arm) -> None:
    start = arm.state().pose
    arm.stop()
    assert not wait(bench, 0.05).moving
    arm.move_to(Pose(start.x - 0.2, start.z, start.pitch))
    assert wait(bench, 0.2).moving
    arm.stop()
    halted = until_rest(bench, limit=1.0)
    assert start.x - 0.19 < halted.pose.x < start.x
    drive(bench, Velocity(0.05, 0.0, 0.0), 0.2)
    arm.stop()
    rested = until_rest(bench, limit=1.0)
    assert not rested.expired
    assert near(wait(bench, 0.3).pose, rested.pose, 2 * bench.accuracy)


def test_velocity_out_of_the_workspace_comes_to_rest_by_itself(bench, arm) -> None:
    # to its floor: not all reach its top
    state = drive(bench, Velocity(0.0, -0.1, 0.0), 2.2)
    assert abs(state.velocity.vz) < 1e-3
    assert -0.02 < state.commanded.z < 0.02
    back = drive(bench, Velocity(0.0, 0.1, 0.0), 0.5)
    assert back.velocity.vz == pytest.approx(0.1, abs=1e-2)


def test_arm_closed_in_motion_may_be_stopped_and_refuses_all_else(bench, arm) -> None:
    drive(bench, Velocity(-0.05, 0.0, 0.0), 0.1)
    arm.close()
    bench.clock.wait_until(bench.clock.now() + 0.5)
    arm.close()
    arm.stop()
    for command in _commands(arm):
        with pytest.raises(Fault):
            command()


def _commands(arm) -> list[Callable[[], object]]:
    return [
        arm.state,
        lambda: arm.move_to(Pose(0.5, 0.1, 0.0)),
        lambda: arm.set_velocity(ZERO_VELOCITY),
    ]
