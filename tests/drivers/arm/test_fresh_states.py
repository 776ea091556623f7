"""A loop that fell behind a robot on its own clock answers what has just come."""

from types import SimpleNamespace

import pytest

pytest.importorskip("pylibfranka", reason="the robot's library is not installed")

import drivers.arm.robot
from drivers.arm.robot import Robot
from drivers.arm.settings import FciSettings

TICK, AT_HAND, ON_THE_WAY = 1e-3, 2e-5, 1e-4  # s: of the robot, to read a state, of each message
ANSWER, AFTER = 0.6e-3, 0.39e-3  # s from a state to its answer, and for what comes after that


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


@pytest.mark.parametrize(("lock_step", "lost"), [(False, range(1, 3)), (True, range(20, 1000))])
def test_a_loop_that_is_too_slow_loses_every_other_command_not_all(
    monkeypatch, lock_step: bool, lost: range
) -> None:
    """In lock-step, where a state is never too old, each is taken as it comes."""
    motion, robot = Millisecond(), Robot.__new__(Robot)
    robot._settings = FciSettings(address="127.0.0.1", lock_step=lock_step)
    monkeypatch.setattr(drivers.arm.robot, "perf_counter", lambda: motion.now)
    assert most_lost(robot, motion, 1000) in lost
