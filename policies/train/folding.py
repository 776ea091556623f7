"""Folds of a generation, cut into equal pieces for whoever computes them."""

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import replace

import numpy as np
import torch

from drivers.strip.rod.engine import Rod
from drivers.types import Array
from policies.domain import grid, sample
from policies.rollout import Folds
from policies.train.objective import costs, fold_all, rollout_settings
from policies.train.settings import TrainingSettings

PIECE = 12  # candidates a piece; fixed, so that no result depends on the number of workers
FINE = 100  # segments of the rod that judges
VALIDATION = 8  # strips a side of the grid that picks among generations


def evaluate_piece(settings: TrainingSettings, candidates: Array, generation: int) -> Array:
    """Costs (p,) of `candidates` in `generation`: a pure function, for any process or machine."""
    torch.set_num_threads(1)
    strips = sample(settings.strips, np.random.default_rng([settings.seed, generation, 0]))
    rng = np.random.default_rng([settings.seed, generation, 1])
    return costs(Rod(settings.segments, strict=False), candidates, strips, settings, rng)


def evaluator(settings: TrainingSettings, executor: Executor) -> Callable[[Array, int], Array]:
    """`evaluate` of the search, in pieces over `executor`."""

    def evaluate(candidates: Array, generation: int) -> Array:
        pieces = [candidates[i : i + PIECE] for i in range(0, len(candidates), PIECE)]
        waiting = [executor.submit(evaluate_piece, settings, p, generation) for p in pieces]
        return np.concatenate([w.result() for w in waiting])

    return evaluate


def validator(settings: TrainingSettings) -> Callable[[Array], float]:
    """`validate` of the search: rms d [m] over a grid with the noise of training.

    The root of the mean square, because a policy is to be good on every strip.
    """

    def validate(weights: Array) -> float:
        folds = grid_folds(weights, VALIDATION, settings, seed=settings.seed)
        return float(np.sqrt(np.mean(scored(folds) ** 2)))

    return validate


def grid_folds(weights: Array, side: int, settings: TrainingSettings, seed: int) -> Folds:
    """The `side` x `side` grid of the paper's range folded by `weights`, finer than training."""
    rollout = replace(rollout_settings(settings), substeps=3)
    rng = np.random.default_rng([seed, 2])
    return fold_all(Rod(FINE, strict=False), np.atleast_2d(weights), grid(side), rollout, rng)


def scored(folds: Folds) -> Array:
    """Displacements (n,) [m], half a strip where the layers never touched."""
    return np.where(folds.touched, folds.displacement, 0.3)
