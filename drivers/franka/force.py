"""External forces on an arm, less those estimated at rest without contact, and their
limits.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot
from typing import Any, Self

import numpy as np

from drivers.base.motion import TICK
from drivers.base.types import Array
from drivers.franka.failure import ArmFault, Cause
from drivers.franka.model import ArmModel

Numbers = tuple[float, ...]
NEWEST = 0.2  # share of the newest state in the torques that are felt
LEAST_WEIGHT = 1.0  # N m, avoids a division by 0
SETTLING = 0.3  # s at rest before a force counts as drift
SMOOTHING = 0.5  # s over which the force is averaged


class OwnTorques:
    """Fraction of the torques that hold and move an arm which wrongly appears in its
    estimate of external torques.

    A wrong model of the masses leaves a part of it in the estimate, and some robots
    report all of it: the same share of its weight, which is found at rest, and of its
    inertia. A push does not follow the arm's motion.
    """

    def __init__(self, model: ArmModel, joints: Sequence[float], felt: Array) -> None:
        """Find the fraction from the external torques `felt` (7,) [N m] estimated at
        rest at `joints` (7,) [rad].
        """
        self._model = model
        self._start = model.torques(joints)
        squares = max(float(self._start @ self._start), LEAST_WEIGHT)
        self.share = float(np.clip(felt @ self._start / squares, -1.0, 1.0))
        self._seconds = 0.0
        self._rate = np.zeros(7)

    def change(self, state: Any) -> Array:
        """Torques (7,) [N m] by which the estimate changes from rest to the robot's
        `state`, in motion.
        """
        seconds = state.time.to_sec()
        rate = np.array(state.dq)
        passed = max(seconds - self._seconds, TICK)
        acceleration = (rate - self._rate) / passed
        self._seconds, self._rate = seconds, rate
        now = self._model.torques(state.q, rate, acceleration)
        return self.share * (now - self._start)


@dataclass(frozen=True, slots=True)
class Tare:
    """External wrench (6,) [N, N m] and torques (7,) [N m] estimated at rest without
    contact.

    Subtracted from later estimates: a real arm's are several newtons off
    (franka_ros#404).
    """

    wrench: Numbers = (0.0,) * 6
    torques: Numbers = (0.0,) * 7
    own: OwnTorques | None = None

    @classmethod
    def from_states(
        cls, states: Sequence[Any], allowed: float, model: ArmModel | None = None
    ) -> Self:
        """Tare from robot `states` at rest without contact; ArmFault for a force above
        `allowed` [N] or NaN.

        With a `model` of the arm, the share of its own torques in it is found, too.
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

        own = None if model is None else OwnTorques(model, states[-1].q, torques)
        return cls(tuple(wrench.tolist()), tuple(torques.tolist()), own)

    def torques_in(self, state: Any) -> Array:
        """Torques (7,) [N m] that the robot would estimate in its `state` without any
        contact.
        """
        torques = np.array(self.torques)
        return torques if self.own is None else torques + self.own.change(state)


@dataclass(slots=True)
class ForceGuard:
    """Limits on the external `force` [N] on the gripper and `torque` [N m] at each
    joint, after subtracting the `tare`.

    Torques are smoothed over some states, in which a controller may let them alternate.
    """

    force: float
    torque: float = 87.0
    tare: Tare = Tare()
    _torques: Array | None = None

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

        expected = self.tare.torques_in(state)
        felt = np.subtract(state.tau_ext_hat_filtered, expected)
        if self._torques is not None:
            felt = self._torques + NEWEST * (felt - self._torques)

        self._torques = felt
        torques = np.abs(felt)
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
        """Monitor with an allowed mean force of `allowed` [N] after `guard`'s tare,
        given one state every `tick` [s].
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
