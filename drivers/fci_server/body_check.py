"""Collision check of the emulated arm with itself and its surroundings, cheap on most ticks."""

from math import inf

import numpy as np

from drivers.fci_server.reflex import Reflex, Violation
from drivers.franka.body import Solids, apart
from drivers.types import Array

LEVER = 1.3  # m at most by which a point of the arm moves per rad of any joint
DEEPER = 1e-6  # m by which a touch must grow to count again: the arm may leave it


class BodyCheck:
    """Checks the arm for collisions only once it has moved far enough for one."""

    def __init__(self, solids: Solids | None = None) -> None:
        """Check the arm against `solids`, or against itself alone."""
        self._solids = solids
        self._seen: Array | None = None
        self._room = 0.0  # m, at the joints that were seen
        self._gaps = [inf, inf]  # m, to itself and to the solids

    def check(self, q: Array) -> None:
        """Raises Violation where joints (7,) [rad] bring the arm into itself or a solid."""
        if self._seen is not None:
            travel = LEVER * float(np.abs(q - self._seen).sum())
            if travel < self._room:
                return
        itself = float(apart(q))
        others = inf if self._solids is None else float(self._solids.clearance(q).min())
        before, self._gaps = self._gaps, [itself, others]
        self._seen, self._room = np.array(q), min(itself, others)
        reflexes = Reflex.SELF_COLLISION_AVOIDANCE_VIOLATION, Reflex.CARTESIAN_REFLEX
        for gap, last, reflex in zip(self._gaps, before, reflexes, strict=True):
            if gap < 0 and gap < min(last, 0.0) - DEEPER:
                raise Violation(reflex)
