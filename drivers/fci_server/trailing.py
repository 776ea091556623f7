"""How a real arm trails its setpoint: a delay and a first-order lag."""

from collections import deque
from math import exp
from typing import Self

import numpy as np

from drivers.fci_server.limits import TICK, Course
from drivers.fci_server.posture import Posture
from drivers.types import Array


class Trailing:
    """The arm's own posture, `delay` [s] and a `lag` [s] behind the commanded one."""

    def __init__(self, posture: Posture, tool: Array, delay: float, lag: float) -> None:
        """From rest in `posture` with a tool (4, 4) on the flange."""
        self.posture = posture
        self._tool = tool
        self._share = 1.0 if lag == 0 else 1.0 - exp(-TICK / lag)
        self._past = deque([posture.q] * (1 + round(delay / TICK)))

    @classmethod
    def of(cls, posture: Posture, tool: Array, delay: float, lag: float) -> Self | None:
        """One at rest in `posture` with a tool (4, 4); None where nothing trails."""
        return cls(posture, tool, delay, lag) if delay or lag else None

    def tick(self, commanded: Array) -> None:
        """One tick on, with joints `commanded` (7,) [rad]."""
        self._past.append(commanded)
        self._past.popleft()
        here = self.posture
        q = here.q + self._share * (self._past[0] - here.q)
        velocity = (q - here.q) / TICK
        acceleration = (velocity - here.joints.velocity) / TICK
        if not np.array_equal(q, here.q) or here.joints.velocity.any():
            self.posture = Posture.of(q, self._tool, Course(velocity, acceleration))
