"""Evaluation of trained weights on strips outside the training set, in rod and chain."""

from collections.abc import Callable
from concurrent.futures import Executor, as_completed
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from drivers.strip.engine import Stepper
from drivers.strip.rod.engine import Rod
from drivers.twin.chain.engine import Chain
from drivers.types import Array
from policies.domain import grid
from policies.train.folding import JUDGING_SEGMENTS
from policies.train.objective import fold_all, rollout_settings
from policies.train.settings import TrainingSettings

LINKS = 80  # of the chain that plays the plant; 60 are 3 mm off for the softest strips
SUBSTEPS = 4  # between decisions: 4.2 ms, which the chain takes in one part


class Engine(StrEnum):
    """Engine of the evaluation: the rod of the training, or the chain with physics of its own."""

    ROD = "rod"
    CHAIN = "chain"


@dataclass(frozen=True, slots=True)
class Evaluation:
    """Displacements (side, side) [m] over a logarithmic grid of strips on one engine.

    They are NaN without a touch; `miss` (side, side) is |d| [m], half a strip without a touch.
    """

    engine: Engine
    displacement: Array
    miss: Array

    @property
    def mean(self) -> float:
        """Mean |d| [m]."""
        return float(self.miss.mean())

    @property
    def most(self) -> float:
        """95 % quantile of |d| [m]."""
        return float(np.quantile(self.miss, 0.95))

    @property
    def worst(self) -> float:
        """Largest |d| [m]."""
        return float(self.miss.max())

    @property
    def untouched(self) -> int:
        """Number of folds that ended without a touch."""
        return int(np.isnan(self.displacement).sum())

    def line(self) -> dict[str, object]:
        """Numbers of the evaluation for a record in JSON, lengths in metres."""
        gone = [None if np.isnan(d) else round(float(d), 6) for d in self.displacement.ravel()]
        return {
            "engine": self.engine.value,
            "side": len(self.displacement),
            "mean": self.mean,
            "p95": self.most,
            "worst": self.worst,
            "untouched": self.untouched,
            "displacement": gone,
        }


def evaluate(
    fold: Callable[..., Array],
    trained: tuple[object, ...],
    side: int,
    executor: Executor,
    watch: Callable[[int, int], None] = lambda _done, _pieces: None,
) -> tuple[Evaluation, ...]:
    """Fold a grid of `side` x `side` strips on each engine, a row for each task of `executor`.

    `fold(*trained, side, engine, row)` gives the displacements (side,) [m] of a row. Engines get
    the same noise and delays. `watch` is called with the number of pieces done and their total.
    """
    pieces = [(engine, row) for engine in reversed(Engine) for row in range(side)]
    waiting = {executor.submit(fold, *trained, side, *piece): piece for piece in pieces}
    rows: dict[tuple[Engine, int], Array] = {}
    for done in as_completed(waiting):
        rows[waiting[done]] = done.result()
        watch(len(rows), len(pieces))
    found = {engine: np.array([rows[engine, row] for row in range(side)]) for engine in Engine}
    half = 0.5 * grid(side)[0].length
    return tuple(
        Evaluation(engine, displacement=d, miss=np.where(np.isnan(d), half, np.abs(d)))
        for engine, d in found.items()
    )


def fold_row(
    weights: Array, settings: TrainingSettings, side: int, engine: Engine, row: int
) -> Array:
    """Fold one row of the grid by `feedback` with weights (p,); returns displacements (side,)."""
    strips = grid(side)[row * side : (row + 1) * side]
    rollout = replace(rollout_settings(settings), substeps=SUBSTEPS)
    rng = np.random.default_rng([settings.seed, 3, row])
    stepper = make_stepper(engine)
    return fold_all(stepper, np.atleast_2d(weights), strips, rollout, rng).displacement


def make_stepper(engine: Engine) -> Stepper:
    """Make the simulation engine of this kind."""
    return Rod(JUDGING_SEGMENTS, strict=False) if engine is Engine.ROD else Chain(LINKS)
