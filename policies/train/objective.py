"""The paper's reward, as a cost to be minimised."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from drivers.strip.describe import describe
from drivers.strip.engine import Stepper
from drivers.strip.file import GRAVITY, StripFile
from drivers.types import Array
from policies.feedback import Feedback
from policies.rollout import Folds, Rollout, roll_out
from policies.sensing import Sensing
from policies.train.settings import TrainingSettings


class Scores(NamedTuple):
    """Scores of p candidates: mean `cost` (p,) [m] and mean |d| `miss` (p,) [m]."""

    cost: Array
    miss: Array


def rollout_settings(settings: TrainingSettings) -> Rollout:
    """Rollout settings of training: late and noisy observations, coarse steps."""
    sensing = Sensing(
        contact_sigma=settings.contact_sigma,
        contact_bias=settings.contact_bias,
        delay=(0.0, settings.delay),
    )
    return Rollout(speed=settings.speed, substeps=settings.substeps, sensing=sensing, profile=False)


def fold_cost(folds: Folds, weight: Array, length: float, force_weight: float) -> Array:
    """Cost -R (n,) [m] of each fold: |d| at the touch, plus a |f_x| / N over the `weight` [N].

    Without a touch, the strip's length plus the remaining distance of the gripper from the fixed
    edge: worse than any touch, and less so the nearer (paper, reward shaping).
    """
    to_edge = np.abs(folds.trace[-1][:, 0])
    end = np.where(folds.touched, np.abs(folds.displacement), length + to_edge)
    return np.asarray(end + force_weight * folds.holding_force / weight)


def scores(
    engine: Stepper,
    candidates: Array,
    strips: Sequence[StripFile],
    settings: TrainingSettings,
    rng: np.random.Generator,
) -> Scores:
    """Scores of `candidates` (p, WEIGHT_COUNT), each over the same strips and noise."""
    folds = fold_all(engine, candidates, strips, rollout_settings(settings), rng)
    weight = np.tile([s.linear_density * s.length * GRAVITY for s in strips], len(candidates))
    length = strips[0].length
    cost = fold_cost(folds, weight, length, settings.force_weight)
    shape = (len(candidates), -1)
    return Scores(
        cost=cost.reshape(shape).mean(axis=1),
        miss=misses(folds, length).reshape(shape).mean(axis=1),
    )


def misses(folds: Folds, length: float) -> Array:
    """|d| (n,) [m] of each fold; half the strip's length where the layers never touched."""
    return np.asarray(np.where(folds.touched, np.abs(folds.displacement), 0.5 * length))


def fold_all(
    engine: Stepper,
    candidates: Array,
    strips: Sequence[StripFile],
    rollout: Rollout,
    rng: np.random.Generator,
) -> Folds:
    """Fold every strip with each of `candidates` (p, WEIGHT_COUNT), candidates outermost."""
    models = [describe(strip) for strip in strips] * len(candidates)
    policy = Feedback(candidates)
    return roll_out(
        policy, engine, strips[0], models, settings=rollout, rng=rng, groups=len(candidates)
    )
