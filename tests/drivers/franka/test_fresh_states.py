"""A loop that fell behind a robot on its own clock answers what has just come."""

from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("pylibfranka", reason="the robot's library is not installed")

import drivers.franka.robot
from drivers.franka.mailbox import CommandKind
from drivers.franka.robot import Robot
from drivers.franka.settings import FciSettings
from drivers.twin.fci_server.wire import RobotCommand
from tests.drivers.franka.rig import JOINTS, LossyRobot, begun, joint_command

# s: of the robot, to read a state, of each message
TICK, AT_HAND, ON_THE_WAY = 1e-3, 2e-5, 1e-4
# s from a state to its answer, and for what comes after that
ANSWER, AFTER = 0.6e-3, 0.39e-3


class Millisecond:
    """A motion of a robot that makes a tick each millisecond, in simulated time."""

    def __init__(self) -> None:
        self.now = 0.0
        self.read, self.heard = -1, set[int]()

    def readOnce(self):  # noqa: N802
        newest = int((self.now - ON_THE_WAY) / TICK)
        if newest <= self.read:
            newest = self.read + 1
            self.now = newest * TICK + ON_THE_WAY
        self.read = newest
        self.now += AT_HAND
        return SimpleNamespace(number=newest), None

    def writeOnce(self, command) -> None:  # noqa: N802
        if self.now + ON_THE_WAY < (command.number + 1) * TICK:
            self.heard.add(command.number)


def most_lost(robot: Robot, motion: Millisecond, ticks: int) -> int:
    """Ticks in a row without an answer."""
    while motion.read < ticks:
        state = robot.read(motion)
        motion.now += ANSWER
        motion.writeOnce(state)
        motion.now += AFTER
    lost = longest = 0
    for tick in range(ticks):
        lost = 0 if tick in motion.heard else lost + 1
        longest = max(longest, lost)
    return longest


@pytest.mark.parametrize(
    ("lock_step", "lost"), [(False, range(1, 3)), (True, range(20, 1000))]
)
def test_a_loop_that_is_too_slow_loses_every_other_command_not_all(
    monkeypatch, lock_step: bool, lost: range
) -> None:
    """In lock-step, where a state is never too old, each is taken as it comes."""
    motion, robot = Millisecond(), Robot.__new__(Robot)
    robot._settings = FciSettings(address="127.0.0.1", lock_step=lock_step)
    monkeypatch.setattr(drivers.franka.robot, "perf_counter", lambda: motion.now)
    assert most_lost(robot, motion, 1000) in lost


class Timed(LossyRobot):
    """A robot on its own clock in simulated time, which a loop's work takes up."""

    def __init__(self) -> None:
        super().__init__(JOINTS)
        self.now, self.row, self.longest = 0.0, 0, 0
        self._next: RobotCommand | None = None
        self._seen = -1

    def read(self, motion: object) -> SimpleNamespace:
        self.now = max(self.now, (self.time + 1) * TICK) + AT_HAND
        self._go_on()
        self._seen, self._answered = self.time, True
        return super().read(motion)

    def _command(self, joints: np.ndarray, last: bool) -> None:
        self._go_on()
        if self._seen == self.time:
            self._next = joint_command(self._seen, joints, last)

    def _go_on(self) -> None:
        while self.time < int(self.now / TICK + 1e-9):
            counted = self._next is None and self.motion and self.motion.started
            self.row = self.row + 1 if counted else 0
            self.longest = max(self.longest, self.row)
            if self._next is None:
                self.miss()
            else:
                self.step(self._next)
                self._heard = True
            self.time, self._next = self.time + 1, None


def test_pose_is_worked_out_before_the_state_arrives_that_it_answers(
    monkeypatch,
) -> None:
    robot = Timed()
    setup = begun(robot, lock_step=False)
    prepare = setup.loop._prepare

    def worked() -> None:
        prepare()
        robot.now += ANSWER

    monkeypatch.setattr(setup.loop, "_prepare", worked)
    for late, lost in ((0, (0,)), (2, (1, 2))):
        robot.now += late * TICK
        setup.order(CommandKind.FOLLOW, -0.1, 0.05, 0.0)
        setup.steps(60)
        assert robot.longest in lost
    assert not robot.errors
