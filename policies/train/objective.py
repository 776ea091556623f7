"""Objective of a training: the paper's reward as a cost, over simulated folds of random
strips.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from pydantic import Field, NonNegativeFloat, NonNegativeInt, PositiveFloat

from drivers.base.settings import Settings
from drivers.base.types import GRAVITY, Array, Calls
from drivers.strip.describe import describe
from drivers.strip.file import StripFile
from drivers.strip.rod.engine import Rod
from policies.feedback import Feedback
from policies.rollout import Folds, Rollout, roll_out
from policies.sensing import Sensing
from policies.strip_sampling import grid, sample

# candidates per piece; fixed, so that no result depends on the number of workers
PIECE = 12
JUDGING_SEGMENTS = 100  # segments of the rod in a validation
VALIDATION = 8  # strips along each side of the grid that a validation folds


class TrainingSettings(Settings):
    """Settings of a training by CMA-ES, and of the folds that evaluate its candidates.

    The same settings and seed give the same weights. `strips` squared strips a
    generation, one from each cell of the paper's range; `force_weight` a [m] scales the
    mean holding force over the strip's weight.
    """

    seed: NonNegativeInt = 0
    generations: int = Field(300, ge=1)
    population: int = Field(48, ge=4)
    sigma: PositiveFloat = 0.05
    strips: int = Field(4, ge=1)
    speed: PositiveFloat = 0.1
    segments: int = Field(60, ge=20)
    substeps: int = Field(2, ge=1)
    contact_sigma: NonNegativeFloat = 0.001
    contact_bias: NonNegativeFloat = 0.001
    delay: NonNegativeFloat = 0.06  # s, largest
    force_weight: NonNegativeFloat = 0.01
    validate_every: int = Field(5, ge=1)

    @property
    def folds_per_generation(self) -> int:
        """Number of folds that one generation simulates."""
        return self.population * self.strips**2

    @property
    def rollout(self) -> Rollout:
        """Settings of the training's folds: late and noisy observations, coarse
        steps.
        """
        sensing = Sensing(
            contact_sigma=self.contact_sigma,
            contact_bias=self.contact_bias,
            delay=(0.0, self.delay),
        )
        return Rollout(
            speed=self.speed, substeps=self.substeps, sensing=sensing, profile=False
        )


class Scores(NamedTuple):
    """Scores of p candidate weights: mean `cost` (p,) [m] and mean |d| `miss` (p,)
    [m].
    """

    cost: Array
    miss: Array


def evaluate(
    settings: TrainingSettings, candidates: Array, generation: int, calls: Calls
) -> Scores:
    """Evaluate `candidates` (p, WEIGHT_COUNT) in `generation`, in equal pieces by
    `calls`.
    """
    pieces = [candidates[i : i + PIECE] for i in range(0, len(candidates), PIECE)]
    found = dict(
        calls(evaluate_piece, [(settings, piece, generation) for piece in pieces])
    )
    scores = [found[number] for number in range(len(pieces))]
    return Scores(*(np.concatenate(parts) for parts in zip(*scores, strict=True)))


def evaluate_piece(
    settings: TrainingSettings, candidates: Array, generation: int
) -> Scores:
    """Evaluate `candidates` (p, WEIGHT_COUNT) on the same strips and noise; equal
    arguments give equal scores.
    """
    strips = sample(
        settings.strips, np.random.default_rng([settings.seed, generation, 0])
    )
    rng = np.random.default_rng([settings.seed, generation, 1])
    folds = fold_all(settings.segments, candidates, strips, settings.rollout, rng)
    weight = np.tile(
        [s.linear_density * s.length * GRAVITY for s in strips], len(candidates)
    )
    length = strips[0].length
    cost = fold_cost(folds, weight, length, settings.force_weight)
    shape = (len(candidates), -1)
    return Scores(
        cost=cost.reshape(shape).mean(axis=1),
        miss=misses(folds, length).reshape(shape).mean(axis=1),
    )


def validate(settings: TrainingSettings, weights: Array) -> float:
    """Rms displacement [m] of folds by `weights` (WEIGHT_COUNT,) over a grid of strips.

    The root mean square, because a policy must be good on every strip.
    """
    rollout = replace(settings.rollout, substeps=3)
    rng = np.random.default_rng([settings.seed, 2])
    strips = grid(VALIDATION)
    folds = fold_all(
        segments=JUDGING_SEGMENTS,
        candidates=np.atleast_2d(weights),
        strips=strips,
        rollout=rollout,
        rng=rng,
    )
    return float(np.sqrt(np.mean(misses(folds, strips[0].length) ** 2)))


def fold_cost(folds: Folds, weight: Array, length: float, force_weight: float) -> Array:
    """Costs (n,) [m] of n folds: |d| at the touch + `force_weight` |f_x| / `weight`
    (n,) [N].

    Without a touch, the strip's length plus the remaining distance of the gripper from
    the fixed edge: worse than any touch, and less so the nearer (paper, reward
    shaping).
    """
    to_edge = np.abs(folds.trace[-1][:, 0])
    end = np.where(folds.touched, np.abs(folds.displacement), length + to_edge)
    return end + force_weight * folds.holding_force / weight


def misses(folds: Folds, length: float) -> Array:
    """Sizes |d| (n,) [m] of n folds' displacements; half the strip's `length` without a
    touch.
    """
    return np.where(folds.touched, np.abs(folds.displacement), 0.5 * length)


def fold_all(
    segments: int,
    candidates: Array,
    strips: Sequence[StripFile],
    rollout: Rollout,
    rng: np.random.Generator,
) -> Folds:
    """Fold all `strips` with each of `candidates` (p, WEIGHT_COUNT): p len(strips)
    folds.
    """
    groups = len(candidates)
    policy = Feedback(candidates)
    engine = Rod(segments, strict=False)
    models = [describe(strip) for strip in strips] * groups
    return roll_out(
        policy, engine, strips[0], models, settings=rollout, rng=rng, groups=groups
    )
