"""Policy `planned`, an upper bound for feedback: it plans by simulation of the known strip."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from drivers.errors import ConfigurationError
from drivers.strip.describe import describe
from drivers.strip.engine import Observables
from drivers.strip.file import StripFile
from drivers.strip.model import StripModel
from drivers.strip.rod.engine import Rod
from drivers.types import Array
from policies.follower import Follower
from policies.path import Path
from policies.policy import Decision, Observation
from policies.rollout import Rollout, roll_out
from policies.sensing import EXACT_SENSING

SEGMENTS = 100
BENT = 0.18  # of the length, height up to which all paths climb as the triangle does
FIRST_RISES = np.linspace(-0.06, 0.22, 8)  # rises tried first, over the length
FINE_STEPS = np.arange(-3.0, 5.0)  # steps around the zero among the first, tried then
RISE_STEP = 1 / 600  # of the length; rises tried are multiples, so that strips share motions


def raise_path(length: float, rise: float) -> Path:
    """Triangular path over a strip of `length` [m], with apex and end moved up by `rise` [m]."""
    bend = BENT * length
    apex = (length / 2, length / 2 + rise)
    return Path.through(np.array([(length, 0.0), (length - bend, bend), apex, (0.0, rise)]))


class Paths:
    """Policy for a batch of strips in which each gripper follows its own of n `paths`."""

    name = "paths"

    def __init__(self, paths: Sequence[Path]) -> None:
        self._each = tuple(paths)
        self._followers: list[Follower] = []
        self._speed = 0.0

    def reset(self, _: StripFile, speed: float, count: int) -> None:
        """Start at the beginning of the paths; ValueError unless `count` is their number."""
        if count != len(self._each):
            raise ValueError(f"{count} strips, but {len(self._each)} paths")
        self._followers = [Follower(path, 1) for path in self._each]
        self._speed = speed

    def lift(self) -> Path:
        """Path of the lift: the first of the paths."""
        return self._each[0]

    def decide(self, observation: Observation) -> Decision:
        """Command the gripper of each strip along its own path."""
        decisions = [
            follower.decide(x, z, self._speed)
            for follower, x, z in zip(
                self._followers, observation.x[:, None], observation.z[:, None], strict=True
            )
        ]
        return Decision(*(np.concatenate(parts) for parts in zip(*decisions, strict=True)))


class Planned(Paths):
    """Policy that follows the raised triangle on which the simulated strip has displacement 0.

    Plans once for a strip and a speed. `strips` are the known strips of a batch; without them all
    equal the strip given at `reset`.
    """

    name = "planned"

    def __init__(self, strips: Sequence[StripFile] = ()) -> None:
        super().__init__(())
        self.rises: Array = np.zeros(0)
        self._strips = tuple(strips)
        self._aim = 0.0
        self._known: tuple[tuple[StripFile, ...], float, float] | None = None

    def correct(self, bias: float) -> None:
        """Correct the aim by a `bias` [m]: measured less simulated d."""
        self._aim = -bias

    def reset(self, strip: StripFile, speed: float, count: int) -> None:
        """Plan for `strip` at `speed` [m/s], unless already planned; or ConfigurationError."""
        asked = (self._strips or (strip,), speed, self._aim)
        if asked != self._known:
            self.rises = plan(*asked)
            self._known = asked
        rises = self.rises if self._strips else np.repeat(self.rises, count)
        self._each = tuple(raise_path(strip.length, float(rise)) for rise in rises)
        super().reset(strip, speed, count)


def plan(strips: Sequence[StripFile], speed: float, aim: float = 0.0) -> Array:
    """Rises (n,) [m] of triangles on which simulated `strips` get the displacement `aim` [m].

    At `speed` [m/s]. Two rounds over all strips in one batch: coarse, then fine around the zero.
    The grippers move as in a fold, with its lift and its limited acceleration. Raises
    ConfigurationError where no path reaches `aim`.
    """
    first_steps = np.round(FIRST_RISES / RISE_STEP).astype(int)
    coarse = np.tile(first_steps, (len(strips), 1))
    displacements = partial(_displacements, strips, speed)
    coarse_misses = displacements(coarse) - aim
    for strip, misses in zip(strips, coarse_misses, strict=True):
        if not (np.any(misses < 0) and np.any(misses > 0)):
            nearest = 1e3 * np.nanmin(np.abs(misses), initial=np.inf)
            raise ConfigurationError(
                f"planned: {strip.name}: no raised triangle folds it with displacement 0 in the "
                f"rod, the smallest |d| is {nearest:.0f} mm; use another policy"
            )
    rough = _interpolate_zeros(coarse, coarse_misses)
    fine = (np.round(rough)[:, None] + FINE_STEPS).astype(int)
    fine_misses = displacements(fine) - aim
    refined = _interpolate_zeros(fine, fine_misses)
    brackets_zero = np.any(fine_misses <= 0, axis=1) & np.any(fine_misses >= 0, axis=1)
    steps = np.where(brackets_zero, refined, rough)
    return steps * RISE_STEP * strips[0].length


def fold_by_plan(planned: StripFile, lying: StripFile) -> tuple[float, Array]:
    """Fold the strip `lying` in simulation, on the path planned for the strip `planned`.

    Returns the displacement [m], NaN without a touch, and the midline (n, 2) [m] at the end.
    """
    rod = Rod()
    rng = np.random.default_rng(0)
    folds = roll_out(Planned(), rod, planned, [describe(lying)], settings=Rollout(), rng=rng)
    return float(folds.displacement[0]), np.asarray(rod.shapes()[0])


def _gripper_poses(strip: StripFile, speed: float, steps: Array) -> tuple[Array, float]:
    """Poses (k, n, 3) [m, m, rad] of grippers on triangles raised by `steps` (n,), and period [s].

    At `speed` [m/s]; a step is RISE_STEP.
    """
    different, numbers = np.unique(steps, return_inverse=True)
    paths = [raise_path(strip.length, step * RISE_STEP * strip.length) for step in different]
    recorder = _PoseRecorder()
    models = [describe(strip)] * len(paths)
    settings = Rollout(speed=speed, sensing=EXACT_SENSING, profile=False)
    rng = np.random.default_rng(0)
    roll_out(Paths(paths), recorder, strip, models, settings=settings, rng=rng)
    return np.array(recorder.poses)[:, numbers], recorder.dt


class _PoseRecorder:
    """An engine without strips that records the grippers' poses."""

    def __init__(self) -> None:
        self.dt = 0.0
        self._count = 0
        self.poses: list[Array] = []  # (n, 3), one entry for each step

    def reset(self, models: Sequence[StripModel]) -> None:
        self._count = len(models)
        self.poses = []

    def step(self, poses: Array, dt: float) -> Observables:
        self.dt = dt
        self.poses.append(poses.copy())
        scalars = np.zeros(self._count)
        points = np.zeros((self._count, 2))
        return Observables(scalars, points, scalars, points, (None,) * self._count)

    def shapes(self) -> Array:
        return np.zeros((self._count, 0, 2))

    def arc(self) -> Array:
        return np.zeros((self._count, 0))


def _displacements(strips: Sequence[StripFile], speed: float, steps: Array) -> Array:
    """Displacements (n, m) [m] of n strips on triangles raised by `steps`; NaN without a touch."""
    rod = Rod(SEGMENTS, strict=False)
    rod.reset([model for model in map(describe, strips) for _ in range(steps.shape[1])])
    touches = rod.advance(*_gripper_poses(strips[0], speed, steps.ravel())).touch
    d = [np.nan if touch is None else touch.displacement for touch in touches]
    return np.array(d).reshape(steps.shape)


def _interpolate_zeros(steps: Array, d: Array) -> Array:
    """Rises (n,) at which displacements are zero: `d` (n, m) are those of rises `steps` (n, m)."""
    zeros = []
    for row, rises in zip(d, steps, strict=True):
        order = np.argsort(row)[: int(np.isfinite(row).sum())]  # NaN sorts last and is left out
        zeros.append(float(np.interp(0.0, row[order], rises[order])))
    return np.array(zeros)
