"""Policy `planned`, an upper bound for feedback: it plans by simulation of the known
strip.
"""

from collections.abc import Sequence

import numpy as np

from drivers.base.errors import ConfigurationError
from drivers.base.types import Array
from drivers.strip.describe import describe
from drivers.strip.file import StripFile
from drivers.strip.rod.engine import Rod
from policies.follower import Follower
from policies.path import Path
from policies.policy import Decision, Observation
from policies.rollout import Rollout, roll_out
from policies.sensing import EXACT_SENSING

SEGMENTS = 100
BENT = 0.18  # of the length, height up to which all paths climb as the triangle does
FIRST_RISES = np.linspace(-0.06, 0.22, 8)  # rises tried first, over the length
FINE_STEPS = np.arange(-3.0, 5.0)  # steps around the zero among the first, tried then
# of the length; rises tried are multiples, so that strips share motions
RISE_STEP = 1 / 600


def _raised_triangle(length: float, rise: float) -> Path:
    """Triangular path over a strip of `length` [m], apex and end `rise` [m] higher (<
    0: lower).
    """
    bend = BENT * length
    apex = (length / 2, length / 2 + rise)
    return Path.through(
        np.array([(length, 0.0), (length - bend, bend), apex, (0.0, rise)])
    )


class RaisedTriangles:
    """Policy in which each of n grippers follows its own triangle, raised by `rises`
    (n,) [m].
    """

    name = "raised"

    def __init__(self, rises: Array) -> None:
        self.rises = rises

    def reset(self, strip: StripFile, speed: float, count: int) -> None:
        """Start all grippers at the beginning of their paths; ValueError unless `count`
        is the number of paths.
        """
        rises = self.rises
        if count != len(rises):
            raise ValueError(f"{count} strips, but {len(rises)} paths")
        # grippers on equal paths move alike: one follower commands them all
        different, self._first, self._same = np.unique(
            rises, return_index=True, return_inverse=True
        )
        paths = [_raised_triangle(strip.length, float(rise)) for rise in different]
        self._followers = [Follower(path, count=1) for path in paths]
        self._speed = speed

    def lift(self) -> Path:
        """Path of the lift: the first of the paths."""
        return self._followers[int(self._same[0])].path

    def decide(self, observation: Observation) -> Decision:
        """Command the gripper of each strip along its own path."""
        points = observation.x[self._first, None], observation.z[self._first, None]
        decisions = [
            follower.decide(x, z, self._speed)
            for follower, x, z in zip(self._followers, *points, strict=True)
        ]
        parts = (
            np.concatenate(part)[self._same] for part in zip(*decisions, strict=True)
        )
        return Decision(*parts)


class Planned(RaisedTriangles):
    """Policy that follows the raised triangle on which the simulated strip has
    displacement 0.

    Plans once for a strip and a speed. `strips` are the known strips of a batch;
    without them all equal the strip given at `reset`.
    """

    name = "planned"

    def __init__(self, strips: Sequence[StripFile] = ()) -> None:
        super().__init__(np.zeros(0))
        self._strips = tuple(strips)
        self._aim = 0.0
        self._known: tuple[tuple[StripFile, ...], float, float] | None = None

    def correct(self, bias: float) -> None:
        """Shift the aim by `bias` [m], the measured less the simulated displacement."""
        self._aim = -bias

    def reset(self, strip: StripFile, speed: float, count: int) -> None:
        """Plan for `strip` at `speed` [m/s], unless already planned; raises
        ConfigurationError where no plan succeeds.
        """
        asked = (self._strips or (strip,), speed, self._aim)
        if asked != self._known:
            self._plan = plan(*asked)
            self._known = asked
        self.rises = self._plan if self._strips else np.repeat(self._plan, count)
        super().reset(strip, speed, count)


def plan(strips: Sequence[StripFile], speed: float, aim: float = 0.0) -> Array:
    """Rises (n,) [m] of triangles on which simulated `strips` get the displacement
    `aim` [m].

    At `speed` [m/s]. Two rounds over all strips in one batch: coarse, then fine around
    the zero. The grippers move as in a fold, with its lift and its limited
    acceleration. Raises ConfigurationError where no path reaches `aim`.
    """
    first_steps = np.round(FIRST_RISES / RISE_STEP).astype(int)
    coarse = np.tile(first_steps, (len(strips), 1))
    misses = _displacements(strips, speed, coarse) - aim
    _check_reached(strips, misses)
    rough = _interpolate_zeros(coarse, misses)

    fine = (np.round(rough)[:, None] + FINE_STEPS).astype(int)
    misses = _displacements(strips, speed, fine) - aim
    brackets_zero = np.any(misses <= 0, axis=1) & np.any(misses >= 0, axis=1)
    steps = np.where(brackets_zero, _interpolate_zeros(fine, misses), rough)
    return steps * RISE_STEP * strips[0].length


def _check_reached(strips: Sequence[StripFile], misses: Array) -> None:
    """Raise ConfigurationError for a strip that no planned path folds in half.

    `misses` (n, m) [m] are displacements of each of `strips` by each path; where they
    never change sign, no path between has displacement 0.
    """
    for strip, miss in zip(strips, misses, strict=True):
        if not (np.any(miss < 0) and np.any(miss > 0)):
            nearest = 1e3 * np.nanmin(np.abs(miss), initial=np.inf)
            raise ConfigurationError(
                f"planned: {strip.name}: no raised triangle folds it with displacement"
                f" 0 in the rod, the smallest |d| is {nearest:.0f} mm"
            )


def fold_by_plan(planned: StripFile, lying: StripFile) -> tuple[float, Array]:
    """Fold the strip `lying` in simulation, on the path planned for the strip
    `planned`.

    Returns the displacement [m], NaN without a touch, and the midline (n, 2) [m] at the
    end.
    """
    rod = Rod()
    rng = np.random.default_rng(0)
    folds = roll_out(
        Planned(), rod, planned, [describe(lying)], settings=Rollout(), rng=rng
    )
    return float(folds.displacement[0]), np.asarray(rod.shapes()[0])


def _displacements(strips: Sequence[StripFile], speed: float, steps: Array) -> Array:
    """Displacements (n, m) [m] of n strips in the rod, at `speed` [m/s]; NaN without a
    touch.

    On triangles raised by `steps` (n, m) of RISE_STEP.
    """
    policy = RaisedTriangles(steps.ravel() * RISE_STEP * strips[0].length)
    models = []
    for strip in strips:
        models.extend([describe(strip)] * steps.shape[1])
    settings = Rollout(speed=speed, sensing=EXACT_SENSING, profile=False)
    rng = np.random.default_rng(0)
    rod = Rod(SEGMENTS, strict=False)
    folds = roll_out(policy, rod, strips[0], models, settings=settings, rng=rng)
    return folds.displacement.reshape(steps.shape)


def _interpolate_zeros(steps: Array, d: Array) -> Array:
    """Rises (n,), in units of `steps` (n, m), at which the displacements `d` (n, m) of
    n strips cross zero.
    """
    zeros = []
    for row, rises in zip(d, steps, strict=True):
        # NaN sorts last and is left out
        order = np.argsort(row)[: int(np.isfinite(row).sum())]
        zeros.append(float(np.interp(0.0, row[order], rises[order])))
    return np.array(zeros)
