"""Folds of one generation, divided into equal pieces for parallel execution."""

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import replace

import numpy as np

from drivers.strip.rod.engine import Rod
from drivers.types import Array
from policies.domain import grid, sample
from policies.train.objective import Scores, fold_all, misses, rollout_settings, scores
from policies.train.settings import TrainingSettings

PIECE = 12  # candidates a piece; fixed, so that no result depends on the number of workers
JUDGING_SEGMENTS = 100  # segments of the rod in a validation
VALIDATION = 8  # strips along each side of the grid that a validation folds


def evaluate_piece(settings: TrainingSettings, candidates: Array, generation: int) -> Scores:
    """Scores of `candidates` (p, WEIGHT_COUNT) in `generation`: pure, callable on any machine."""
    strips = sample(settings.strips, np.random.default_rng([settings.seed, generation, 0]))
    rng = np.random.default_rng([settings.seed, generation, 1])
    return scores(Rod(settings.segments, strict=False), candidates, strips, settings, rng)


def evaluator(settings: TrainingSettings, executor: Executor) -> Callable[[Array, int], Scores]:
    """The search's `evaluate` function, which runs pieces of a generation over `executor`."""

    def evaluate(candidates: Array, generation: int) -> Scores:
        pieces = [candidates[i : i + PIECE] for i in range(0, len(candidates), PIECE)]
        jobs = [executor.submit(evaluate_piece, settings, p, generation) for p in pieces]
        found = [job.result() for job in jobs]
        return Scores(*(np.concatenate(parts) for parts in zip(*found, strict=True)))

    return evaluate


def validate(settings: TrainingSettings, weights: Array) -> float:
    """Rms displacement [m] by `weights` (WEIGHT_COUNT,) over a grid, with noise, in a finer rod.

    The root mean square, because a policy must be good on every strip.
    """
    rollout = replace(rollout_settings(settings), substeps=3)
    rng = np.random.default_rng([settings.seed, 2])
    strips = grid(VALIDATION)
    folds = fold_all(
        Rod(JUDGING_SEGMENTS, strict=False), np.atleast_2d(weights), strips, rollout, rng
    )
    return float(np.sqrt(np.mean(misses(folds, strips[0].length) ** 2)))


def validator(settings: TrainingSettings, executor: Executor) -> Callable[[Array], float]:
    """The search's `validate` function, run over `executor`."""
    return lambda weights: executor.submit(validate, settings, weights).result()
