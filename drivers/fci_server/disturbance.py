"""Execution of the fault script, tick by tick."""

from collections.abc import Iterable, Iterator
from math import inf

import numpy as np

from drivers.fci_server.faults import ContactFault, Fault, NanFault, ReflexFault, UserStopFault
from drivers.fci_server.reflex import Reflex
from drivers.fci_server.robot import Robot


class Disturbance:
    """Pending faults of the script, and the end times of those in effect."""

    def __init__(self, script: Iterable[Fault]) -> None:
        self._waiting = sorted(script, key=lambda fault: fault.at)
        self._push_ends = inf
        self._nan_ends = 0.0
        self._release = inf

    def is_nan(self, time: int) -> bool:
        """Whether the measured part of the state at robot `time` [ms] is to be NaN."""
        return time < self._nan_ends

    def add(self, fault: Fault) -> None:
        """Schedule one more fault, at its tick, or at once if its tick has passed."""
        self._waiting = sorted([*self._waiting, fault], key=lambda waiting: waiting.at)

    def strike(self, robot: Robot) -> Iterator[Fault]:
        """Apply the due faults to `robot`; yields those of connections and time for the caller."""
        self._end_faults(robot)
        while self._waiting and self._waiting[0].at <= robot.ticks:
            fault = self._waiting.pop(0)
            if not self._apply(robot, fault):
                yield fault

    def _apply(self, robot: Robot, fault: Fault) -> bool:
        """Apply a fault of the robot itself; False for any other."""
        if isinstance(fault, ReflexFault):
            robot.reflex(Reflex[fault.error.upper()])
        elif isinstance(fault, UserStopFault):
            robot.press_user_stop()
            self._release = robot.time + 1000 * fault.duration
        elif isinstance(fault, NanFault):
            self._nan_ends = robot.time + 1 + fault.ticks
        elif isinstance(fault, ContactFault):
            robot.pushed = np.array(fault.force)
            self._push_ends = robot.time + 1000 * fault.duration
        else:
            return False
        return True

    def _end_faults(self, robot: Robot) -> None:
        """Release the user stop and take the force away where their time is over."""
        if robot.time >= self._release:
            robot.release_user_stop()
            self._release = inf
        if robot.time >= self._push_ends:
            robot.pushed = np.zeros(3)
            self._push_ends = inf
