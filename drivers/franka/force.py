"""External forces on an arm, less those estimated at rest without contact, and their
limits.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot
from typing import Any, Self

import numpy as np

from drivers.franka.failure import ArmFault, Cause

Numbers = tuple[float, ...]
SETTLING = 0.3  # s at rest before a force counts as drift
SMOOTHING = 0.5  # s over which the force is averaged


@dataclass(frozen=True, slots=True)
class Tare:
    """External wrench (6,) [N, N m] and torques (7,) [N m] estimated at rest without
    contact.

    Subtracted from later estimates: a real arm's are several newtons off
    (franka_ros#404).
    """

    wrench: Numbers = (0.0,) * 6
    torques: Numbers = (0.0,) * 7

    @classmethod
    def from_states(cls, states: Sequence[Any], allowed: float) -> Self:
        """Tare from robot `states` at rest; ArmFault for a force above `allowed` [N] or
        NaN.
        """
        wrench = np.mean([state.O_F_ext_hat_K for state in states], axis=0)
        torques = np.mean([state.tau_ext_hat_filtered for state in states], axis=0)
        force = float(np.linalg.norm(wrench[:3]))
        if not force <= allowed:
            reason = f"the gripper feels {force:.1f} N at rest, allowed {allowed:.1f} N"
            raise ArmFault(Cause.PRESSED, reason)
        if not (np.isfinite(wrench).all() and np.isfinite(torques).all()):
            reason = "the robot reports moments or torques at rest that are no numbers"
            raise ArmFault(Cause.PRESSED, reason)
        return cls(tuple(wrench.tolist()), tuple(torques.tolist()))


@dataclass(frozen=True, slots=True)
class ForceGuard:
    """Limits on external `force` [N] on the gripper and `torque` [N m] at a joint, less
    `tare`.
    """

    force: float
    torque: float = 87.0
    tare: Tare = Tare()

    def beyond_tare(self, state: Any) -> list[float]:
        """External wrench (6,) [N, N m] on the gripper in the robot's `state`, less the
        tare.
        """
        return [
            a - b for a, b in zip(state.O_F_ext_hat_K, self.tare.wrench, strict=True)
        ]

    def objection(self, state: Any) -> str:
        """Reason to stop a robot in `state`: a force or torque above its limit; empty
        for none.
        """
        force = hypot(*self.beyond_tare(state)[:3])
        if not force <= self.force:
            return f"the gripper met {force:.1f} N, allowed {self.force:.1f} N"
        torques = np.abs(np.subtract(state.tau_ext_hat_filtered, self.tare.torques))
        largest = torques.max()  # NaN if any torque is NaN
        if not largest <= self.torque:
            joint = torques.argmax() + 1
            return f"joint {joint} met {largest:.1f} N m, allowed {self.torque:.1f} N m"
        return ""


class DriftMonitor:
    """Monitors the mean external force, less the tare, on an arm at rest, which should
    be zero.

    It detects an outdated tare, or a person who leans on the arm, below the limit of
    the guard.
    """

    def __init__(self, guard: ForceGuard, allowed: float, tick: float) -> None:
        """Allow a mean force of `allowed` [N] less `guard`'s tare, a state every `tick`
        [s].
        """
        self._guard = guard
        self._allowed = allowed
        self._tick = tick
        self._rested = 0.0
        self._mean = [0.0, 0.0, 0.0]

    def objection(self, state: Any, *, moving: bool) -> str:
        """Reason to stop an arm in `state`: its mean force has drifted; empty for
        none.
        """
        self._rested = 0.0 if moving else self._rested + self._tick
        if self._rested < SETTLING:
            self._mean = [0.0, 0.0, 0.0]
            return ""
        share = self._tick / SMOOTHING
        wrench = self._guard.beyond_tare(state)
        self._mean = [
            m + share * (f - m) for m, f in zip(self._mean, wrench[:3], strict=True)
        ]
        force = hypot(*self._mean)
        if force <= self._allowed:
            return ""
        return (
            f"the force felt at rest drifted to {force:.1f} N, allowed"
            f" {self._allowed:.1f} N"
        )
