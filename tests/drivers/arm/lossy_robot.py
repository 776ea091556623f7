"""The emulated robot behind a network that loses commands, without a network."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from drivers.fci_server.robot import MOST_MISSED_TICKS, resting_robot
from drivers.fci_server.wire import MoveRequest, RobotCommand

JOINT_POSITION, CARTESIAN_POSE = 0, 2


class LossyRobot:
    """Loses one command in ten, or what follows it, up to `worst` ticks at a time.

    A lost command is continued by the robot itself, by the rules of its server, so every limit
    holds that a robot would enforce. Fewer than MOST_MISSED_TICKS are lost in a row. States are
    rounded as on the wire.
    """

    def __init__(self, joints: Any, seed: int, worst: int, share: float = 0.1) -> None:
        self.robot = resting_robot(np.array(joints))
        self.lost = 0
        self.ended = False
        self._rng = np.random.default_rng(seed)
        self._worst, self._share = worst, share
        self._in_a_row = 0
        self._heard = False
        self._answered = True

    def start_poses(self) -> "LossyRobot":
        return self._start(CARTESIAN_POSE)

    def start_joints(self) -> "LossyRobot":
        return self._start(JOINT_POSITION)

    def write_pose(self, motion: object, pose: list[float], *, last: bool = False) -> None:
        self._command(np.zeros(7), np.reshape(pose, (4, 4)).T, last)

    def write_joints(self, motion: object, joints: list[float], *, last: bool = False) -> None:
        self._command(np.array(joints), np.eye(4), last)

    def read(self, motion: object, *, awaited: bool = True) -> SimpleNamespace:
        if not self._answered:
            self.robot.miss()
            self.robot.time += 1
            self._in_a_row += 1
        self._answered = False
        posture, now = self.robot.posture, self.robot.time
        return SimpleNamespace(
            time=SimpleNamespace(to_sec=lambda: 1e-3 * now),
            q=rounded(posture.q),
            q_d=rounded(posture.q),
            dq_d=rounded(posture.joints.velocity),
            ddq_d=rounded(posture.joints.acceleration),
            O_T_EE=rounded(posture.reached.T.ravel()),
            O_T_EE_c=rounded(posture.pose.T.ravel()),
            O_dP_EE_c=rounded(posture.tool.velocity),
            O_ddP_EE_c=rounded(posture.tool.acceleration),
            O_F_ext_hat_K=[0.0] * 6,
            tau_ext_hat_filtered=[0.0] * 7,
            control_command_success_rate=float(self._heard),
        )

    def _start(self, generator: int) -> "LossyRobot":
        self.robot.move(MoveRequest(1, generator, (0.1,) * 6, False), 1)
        return self

    def _command(self, joints: np.ndarray, pose: np.ndarray, last: bool) -> None:
        """Hear it or lose it, and lose the ticks after it or not."""
        self._answered = True
        if self._rng.random() >= self._share:
            self._heard = True
            self.robot.step(
                RobotCommand(self.robot.time, joints, np.zeros(7), pose, np.zeros(6), None, last)
            )
            self.robot.time += 1
            self._in_a_row = 0
            lost = self._some() if self._rng.random() < self._share else 0
        else:
            lost = self._some()
        for _ in range(min(lost, MOST_MISSED_TICKS - 1 - self._in_a_row)):
            self.robot.miss()
            self.robot.time += 1
            self.lost += 1
            self._in_a_row += 1
        self.ended = last

    def _some(self) -> int:
        return int(self._rng.integers(1, self._worst + 1))


def rounded(numbers: np.ndarray) -> list[float]:
    """As on the wire."""
    return np.float32(numbers).tolist()
