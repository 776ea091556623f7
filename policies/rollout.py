"""Simulated folds of a batch of strips in closed loop, with any policy and any
engine.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from drivers.base.types import Array
from drivers.strip.engine import Observables, Stepper, Touch
from drivers.strip.file import StripFile
from drivers.strip.model import StripModel
from policies.path import TAKEOVER_HEIGHT, Path
from policies.policy import Decision, Policy
from policies.sensing import Draws, Sensing, SimulatedCamera

NO_SHAPES = (np.empty((0, 0, 2)), np.empty((0, 0)))
# of the height of a path below TAKEOVER_HEIGHT, at which its lift ends
LIFT_SHARE = 0.9
ACCELERATION = 2.0  # m/s^2 of a gripper at most
TINY_SPEED = 1e-12  # m/s, against a division by zero


@runtime_checkable
class MultiStepper(Protocol):
    """Protocol of an engine that executes several steps in one call."""

    def advance(self, poses: Array, dt: float) -> Observables:
        """Advance by a step of `dt` [s] to each of `poses` (k, n, 3) [m, m, rad]."""


@dataclass(frozen=True, slots=True)
class Rollout:
    """Settings of simulated folds: gripper speed [m/s], rate of decisions [Hz], noise
    of measurements.

    Between decisions the engine makes `substeps` steps; a fold without a touch is given
    up after a travel of `patience` times the strip's length. Policies that read no
    `profile` run faster without it.
    """

    speed: float = 0.1
    rate: float = 60.0
    substeps: int = 3
    patience: float = 2.4
    sensing: Sensing = field(default_factory=Sensing)
    profile: bool = True

    @property
    def period(self) -> float:
        """Time [s] between two decisions."""
        return 1.0 / self.rate


@dataclass(frozen=True, slots=True)
class Folds:
    """Results of n simulated folds: displacements, touches, forces and traces.

    `displacement` (n,) [m], NaN without a touch; mean size (n,) [N] of the horizontal
    force on the fixed edge until the touch: `holding_force` from the start, `pull` from
    the take-over on, as in the paper; gripper `trace` (k, n, 2) [m].
    """

    displacement: Array
    touch: tuple[Touch | None, ...]
    holding_force: Array
    pull: Array
    trace: Array

    @property
    def touched(self) -> NDArray[np.bool_]:
        """Mask (n,) of the folds that ended in a touch."""
        return np.isfinite(self.displacement)


@dataclass(frozen=True, slots=True)
class Misses:
    """Statistics of the size |d| of displacements [m], NaN where there are none, and
    the number of folds without a touch.
    """

    mean: float
    quantile_95: float
    worst: float
    untouched: int

    @classmethod
    def from_displacements(cls, displacement: Array) -> Self:
        """Mean, 95 % quantile and maximum of |d| over `displacement` d (..., n) [m].

        Folds without a touch, NaN, are left out and counted.
        """
        d = np.abs(displacement[np.isfinite(displacement)])
        lost = displacement.size - d.size
        if d.size == 0:
            return cls(mean=np.nan, quantile_95=np.nan, worst=np.nan, untouched=lost)
        return cls(
            mean=float(d.mean()),
            quantile_95=float(np.quantile(d, 0.95)),
            worst=float(d.max()),
            untouched=lost,
        )


def roll_out(
    policy: Policy,
    engine: Stepper,
    strip: StripFile,
    models: Sequence[StripModel],
    *,
    settings: Rollout,
    rng: np.random.Generator,
    groups: int = 1,
) -> Folds:
    """Fold the strips `models` in one batch; the policy gets only `strip` and
    observations.

    `groups` equal groups of strips get the same noise and delays, so that candidates
    can be compared.
    """
    policy.reset(strip, settings.speed, len(models))
    engine.reset(models)
    draws = Draws(groups, len(models) // groups, rng)
    camera = SimulatedCamera(
        settings.sensing, settings.period, draws, profile=settings.profile
    )
    loop = _Loop(engine=engine, settings=settings, camera=camera, count=len(models))
    loop.lift(policy.lift())

    decisions = round(settings.patience * strip.length / settings.speed * settings.rate)
    for _ in range(decisions):
        decision = policy.decide(loop.camera.observe(loop.time, loop.poses[:, :2]))
        if loop.execute(decision):
            break

    return loop.folds()


class _Loop:
    """Closed loop of n grippers and strips, which advances their state between two
    decisions of a policy.
    """

    def __init__(
        self, engine: Stepper, settings: Rollout, camera: SimulatedCamera, count: int
    ) -> None:
        """Closed loop of `count` folds, before their lift."""
        self.camera = camera
        self.time = 0.0
        self.poses: Array = np.zeros((count, 3))
        self._engine = engine
        self._settings = settings
        self._dt = settings.period / settings.substeps
        self._velocity: Array = np.zeros((count, 2))
        self._lifted: NDArray[np.bool_] = np.zeros(count, dtype=bool)
        # sums over the whole fold, and from the take-over on
        self._force = np.zeros((2, count))
        self._periods = np.zeros((2, count))
        self._trace: list[Array] = []
        self._touch: tuple[Touch | None, ...] = ()
        self._folding: NDArray[np.bool_] = np.zeros(count, dtype=bool)
        self._step_all = (
            engine.advance if isinstance(engine, MultiStepper) else self._step_each
        )

    def lift(self, path: Path) -> None:
        """Move all grippers along `path` from rest up to the take-over height."""
        dt = self._dt
        count = len(self.poses)
        height = min(TAKEOVER_HEIGHT, LIFT_SHARE * float(path.points[:, 1].max()))

        travel = 0.0
        speed = 0.0
        while path.at(travel)[1] < height:
            travels = []
            for _ in range(self._settings.substeps):
                speed = min(self._settings.speed, speed + ACCELERATION * dt)
                travel += speed * dt
                travels.append(travel)
            poses = path.poses(np.array(travels))
            self._advance(np.repeat(poses[:, None], count, axis=1))

        last_step = path.at(travel) - path.at(travel - speed * dt)
        self._velocity = np.tile(last_step / dt, (count, 1))

    def execute(self, decision: Decision) -> bool:
        """Execute `decision` until the next one is due; returns whether all folds have
        ended.
        """
        if not np.any(self._folding & ~decision.done):
            return True
        self._advance(self._turn_into(decision))
        return False

    def _turn_into(self, decision: Decision) -> Array:
        """Poses (substeps, n, 3) of the grippers as their velocities change to the
        decided ones.
        """
        phi = decision.direction
        heading = np.stack([np.cos(phi), np.sin(phi)], axis=-1)
        decided = decision.speed[:, None] * heading

        largest_change = ACCELERATION * self._dt
        poses = np.tile(self.poses, (self._settings.substeps, 1, 1))
        points = self.poses[:, :2]
        for pose in poses:
            change = decided - self._velocity
            size = np.hypot(change[:, 0], change[:, 1])
            share = np.minimum(1.0, largest_change / (size + TINY_SPEED))
            self._velocity = self._velocity + change * share[:, None]
            points = points + self._velocity * self._dt
            pose[:, :2] = points
        return poses

    def folds(self) -> Folds:
        """Displacements, touches, forces and traces of the folds, up to now."""
        displacements = [
            np.nan if touch is None else touch.displacement for touch in self._touch
        ]
        holding_force, pull = self._force / np.maximum(self._periods, 1)
        return Folds(
            displacement=np.array(displacements),
            touch=self._touch,
            holding_force=holding_force,
            pull=pull,
            trace=np.array(self._trace),
        )

    def _advance(self, poses: Array) -> None:
        """Move grippers through `poses` (k, n, 3) [m, m, rad], sum forces, and show the
        strips to the camera.
        """
        observed = self._step_all(poses, self._dt)
        if observed.touch is not self._touch:
            self._touch = observed.touch
            self._folding = np.array([touch is None for touch in observed.touch])

        self._lifted |= poses[-1, :, 1] >= TAKEOVER_HEIGHT
        # sums over the whole fold, and over what follows the take-over
        in_sum = np.stack([np.ones_like(self._lifted), self._lifted])
        counted = self._folding & in_sum
        self._force += np.where(counted, np.abs(observed.holding_force), 0.0)
        self._periods += counted

        self.time += self._settings.period
        self.poses = poses[-1]
        shapes, arc = NO_SHAPES
        if self.camera.wants_shapes:
            shapes = self._engine.shapes()
            arc = self._engine.arc()
        self.camera.store(observed, shapes, arc, self.poses[:, :2])
        self._trace.append(self.poses[:, :2].copy())

    def _step_each(self, poses: Array, dt: float) -> Observables:
        for pose in poses[:-1]:
            self._engine.step(pose, dt)
        return self._engine.step(poses[-1], dt)
