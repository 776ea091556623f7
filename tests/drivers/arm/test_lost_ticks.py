"""The 1 kHz loop on a network that loses packets: the robot goes on by itself meanwhile."""

from types import SimpleNamespace

import numpy as np
import pytest

from drivers.arm.messages import Kind
from drivers.arm.plane import StripPlane
from drivers.twin.server.robot import resting_robot
from drivers.twin.server.wire import MoveRequest, RobotCommand
from drivers.types import Pose
from tests.drivers.arm.test_loop import JOINTS, PLANE, begun_with

CARTESIAN_POSE = 2


class LossyRobot:
    """The emulated robot behind a network that loses up to `worst` packets after each command."""

    def __init__(self, seed: int, worst: int) -> None:
        self.robot = resting_robot(np.array(JOINTS))
        self.lost = 0
        self._rng = np.random.default_rng(seed)
        self._worst = worst

    def start_poses(self) -> "LossyRobot":
        self.robot.move(MoveRequest(1, CARTESIAN_POSE, (0.1,) * 6, False), 1)
        return self

    def write_pose(self, motion: object, pose: list[float], *, last: bool = False) -> None:
        numbers = np.reshape(pose, (4, 4)).T
        command = RobotCommand(
            self.robot.time, np.zeros(7), np.zeros(7), numbers, np.zeros(6), None, last
        )
        self.robot.step(command)
        self.robot.time += 1
        if self._rng.random() < 0.1:
            for _ in range(self._rng.integers(1, self._worst + 1)):
                self.robot.miss()
                self.robot.time += 1
                self.lost += 1

    def read(self, motion: object) -> SimpleNamespace:
        posture, now = self.robot.posture, self.robot.time
        return SimpleNamespace(
            time=SimpleNamespace(to_sec=lambda: 1e-3 * now),
            q=posture.q.tolist(),
            O_T_EE=posture.reached.T.ravel().tolist(),
            O_T_EE_c=np.float32(posture.pose.T.ravel()).tolist(),
            O_dP_EE_c=np.float32(posture.tool.velocity).tolist(),
            O_ddP_EE_c=np.float32(posture.tool.acceleration).tolist(),
            O_F_ext_hat_K=[0.0] * 6,
            control_command_success_rate=1.0,
        )


@pytest.mark.parametrize("worst", [1, 8])
def test_lost_packets_stop_no_motion_and_move_no_goal(worst: int) -> None:
    robot = LossyRobot(seed=worst, worst=worst)
    setup = begun_with(robot)
    goal = Pose(0.45, 0.25, 0.6)
    setup.order(Kind.MOVE, goal.x, goal.z, goal.pitch)
    report = setup.steps(400)
    setup.order(Kind.FOLLOW, 0.1, 0.0, -0.3)
    setup.steps(60)
    setup.order(Kind.MOVE, goal.x, goal.z, goal.pitch)
    report = setup.steps(1600)
    assert robot.lost > 80
    assert not robot.robot.errors
    assert (report.x, report.z, report.pitch) == pytest.approx(
        (goal.x, goal.z, goal.pitch), abs=1e-4
    )


@pytest.mark.parametrize("turned", [False, True])
def test_rates_in_the_plane_are_those_of_its_poses(turned: bool) -> None:
    plane, step = StripPlane(PLANE, turned=turned), 1e-6
    here, rates = np.array([0.5, 0.2, 0.7]), np.array([0.1, -0.2, 0.9])
    before, after = (plane.matrix(*(here + k * step * rates)) for k in (-1, 1))
    change = (after - before) / (2 * step)
    spin = change[:3, :3] @ plane.matrix(*here)[:3, :3].T
    twist = [*change[:3, 3], spin[2, 1], spin[0, 2], spin[1, 0]]
    assert plane.rates(twist) == pytest.approx(rates, abs=1e-6)
