"""Lag of a real arm behind its setpoint: delay, first-order filter, elastic gears."""

from collections import deque
from collections.abc import Callable
from math import exp
from typing import Self

import numpy as np

from drivers.fci_server.limits import TICK, Course
from drivers.fci_server.posture import Posture
from drivers.types import Array

Sag = Callable[[Posture], Array]


class Trailing:
    """Posture of an arm that follows the commanded one with a `delay` [s] and a `lag` [s].

    Its links deflect by a `sag` (7,) [rad] behind its motors, where there is one.
    """

    def __init__(
        self, posture: Posture, tool: Array, delay: float, lag: float, sag: Sag | None = None
    ) -> None:
        """Start at rest in `posture` with a tool (4, 4) on the flange."""
        self._tool, self._sag = tool, sag
        self._share = 1.0 if lag == 0 else 1.0 - exp(-TICK / lag)
        self._past = deque([posture.q] * (1 + round(delay / TICK)))
        self._motors = self.posture = posture
        if sag is not None:
            self.posture = Posture.resting(posture.q - sag(posture), tool)

    @classmethod
    def of(
        cls, posture: Posture, tool: Array, delay: float, lag: float, sag: Sag | None = None
    ) -> Self | None:
        """A lagging arm at rest in `posture` with a tool (4, 4); None where no lag is set."""
        return cls(posture, tool, delay, lag, sag) if delay or lag or sag is not None else None

    def tick(self, commanded: Array) -> None:
        """Advance the arm by one tick behind the joints `commanded` (7,) [rad]."""
        self._past.append(commanded)
        self._past.popleft()
        here = self._motors
        q = here.q + self._share * (self._past[0] - here.q)
        if np.array_equal(q, here.q) and not here.joints.velocity.any():
            return
        self._motors = self._step(here, q)
        if self._sag is None:
            self.posture = self._motors
        else:
            self.posture = self._step(self.posture, q - self._sag(self._motors))

    def _step(self, before: Posture, q: Array) -> Posture:
        velocity = (q - before.q) / TICK
        acceleration = (velocity - before.joints.velocity) / TICK
        return Posture.of(q, self._tool, Course(velocity, acceleration))
