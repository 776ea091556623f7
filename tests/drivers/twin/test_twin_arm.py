"""The twin's arm and hand on one clock with the real chain."""

import numpy as np
import pytest

from drivers.base.types import Pose, Velocity
from tests.support.twin_moves import (
    DENIM,
    Steps,
    drive,
    grasp,
    lift,
    move,
    twin_with,
    wait,
)

L = DENIM.length


def test_strip_tip_is_on_the_true_gripper_path_in_steady_motion() -> None:
    twin = twin_with()
    steps = Steps(twin.world)
    grasp(twin)
    lift(twin)
    truth = steps.truth()
    steady = truth.t > truth.t[-1] - 0.7
    off = truth.shapes[steady, -1] - truth.edge[steady, :2]
    assert np.abs(np.hypot(*off.T)).max() < 1e-4


def test_strip_follows_the_true_pose_and_the_arm_measures_it_with_its_noise() -> None:
    twin = twin_with(noise=2e-4, pitch_noise=1e-3)
    errors = []
    for _ in range(400):
        wait(twin, 0.005)
        true = twin.world.gripper.as_array()
        errors.append(twin.arm.state().pose.as_array() - true)
    spread = np.std(errors, axis=0)
    assert spread == pytest.approx([2e-4, 2e-4, 1e-3], rel=0.15)
    assert np.abs(np.mean(errors, axis=0)) == pytest.approx(np.zeros(3), abs=2e-4)


@pytest.mark.parametrize("lag", [0.0, 0.004, 0.03])
def test_true_pose_trails_the_command_by_the_lag(lag: float) -> None:
    twin = twin_with(lag=lag, noise=0.0, pitch_noise=0.0)
    drive(twin, Velocity(-0.1, 0.0, 0.0), 1.0)
    state = twin.arm.state()
    behind = (state.pose.x - state.commanded.x) / 0.1
    assert behind == pytest.approx(lag, abs=6e-4)
    assert state.velocity.vx == pytest.approx(-0.1, rel=1e-3)


def test_motion_has_ended_only_when_the_arm_is_where_it_was_sent() -> None:
    twin = twin_with(lag=0.05, noise=0.0, pitch_noise=0.0)
    move(twin, Pose(0.4, 0.2, 0.5))
    assert twin.arm.state().pose.as_array() == pytest.approx([0.4, 0.2, 0.5], abs=2e-5)


def test_arm_that_is_let_go_in_motion_brakes_in_the_world() -> None:
    twin = twin_with()
    drive(twin, Velocity(-0.1, 0.0, 0.0), 0.5)
    twin.arm.close()
    wait(twin, 0.3)
    rest = twin.world.gripper
    wait(twin, 0.3)
    assert twin.world.gripper.as_array() == pytest.approx(rest.as_array(), abs=1e-9)
    assert rest.x > L - 0.08


def test_how_often_the_arm_is_read_does_not_change_the_world() -> None:
    def run(reads: int) -> tuple[Pose, bytes]:
        twin = twin_with()
        arm = twin.arm
        grasp(twin)
        for _ in range(20):
            arm.set_velocity(Velocity(-0.05, 0.05, 0.0))
            for _ in range(reads):
                arm.state()
            wait(twin, 0.01)
        return arm.state().pose, twin.world.scene(twin.world.time).points.tobytes()

    assert run(0) == run(3)


def test_size_of_the_waits_does_not_change_the_world() -> None:
    def run(parts: int) -> bytes:
        twin = twin_with()
        grasp(twin)
        twin.arm.move_to(Pose(0.4, 0.2, 1.5))
        start = twin.clock.now()
        for part in range(1, parts + 1):
            twin.clock.wait_until(start + 0.6 * part / parts)
        return twin.world.scene(twin.world.time).points.tobytes()

    assert run(1) == run(137)


def test_hand_takes_half_a_second_to_close() -> None:
    twin = twin_with()
    hand = twin.hand
    hand.grasp()
    wait(twin, 0.25)
    assert hand.state().width == pytest.approx(0.02)
    wait(twin, 0.24)
    assert hand.state().moving
    wait(twin, 0.02)
    assert not hand.state().moving
