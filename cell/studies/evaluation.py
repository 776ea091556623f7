"""Evaluation of a trained policy on strips not used in its training, in rod and
chain.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Literal, TypeVar

import numpy as np
from threadpoolctl import threadpool_limits

from cell.base.campaign.progress import Meter
from drivers.base.types import Array, Calls
from drivers.strip.describe import describe
from drivers.strip.engine import Stepper
from drivers.strip.file import StripFile
from drivers.strip.rod.engine import Rod
from drivers.twin.chain.engine import Chain
from policies.policy import Policy
from policies.rollout import Misses, Rollout, roll_out
from policies.strip_sampling import (
    CONDITIONS,
    STRIP_LENGTH,
    grid,
    strip_under_condition,
)
from policies.train.objective import JUDGING_SEGMENTS

Key = TypeVar("Key")
Table = tuple[Sequence[str], Sequence[Sequence[str]], str]
EngineName = Literal["rod", "chain"]
ENGINES: dict[EngineName, str] = {
    "rod": "rod (the model)",
    "chain": "chain (the plant)",
}
LINKS = 80  # of the chain that plays the plant; 60 are 3 mm off for the softest strips
STRIPS_PER_EFFECT = 64  # folded for each effect
EFFECTS_STREAM = 4  # of random numbers, apart from those of the training


def stepper(name: EngineName) -> Stepper:
    """Simulation engine called `name`: the rod used in training, or the independent
    chain.
    """
    return Rod(JUDGING_SEGMENTS, strict=False) if name == "rod" else Chain(LINKS)


@dataclass(frozen=True, slots=True)
class Evaluation:
    """Displacements (side, side) [m] over a logarithmic grid of strips on one engine,
    NaN without a touch; in `misses` a fold without a touch counts as off by half the
    strip's length.
    """

    engine: EngineName
    displacement: Array
    misses: Misses

    @property
    def untouched(self) -> int:
        """Number of folds that ended without a touch."""
        return int(np.isnan(self.displacement).sum())

    def line(self) -> dict[str, object]:
        """JSON object of the evaluation, lengths in m."""
        gone = [
            None if np.isnan(d) else round(float(d), 6)
            for d in self.displacement.ravel()
        ]
        return {
            "engine": self.engine,
            "side": len(self.displacement),
            **_miss_numbers(self.misses),
            "untouched": self.untouched,
            "displacement": gone,
        }


@dataclass(frozen=True, slots=True)
class EffectErrors:
    """Displacements (n,) [m] of strips in which `effect` is hidden; NaN without a
    touch.
    """

    effect: str
    displacement: Array

    def facts(self) -> dict[str, float | int]:
        """Bias, mean, 95 % quantile and largest |d| [m], and how many folds did not
        touch.
        """
        d = self.displacement
        return {
            "strips": len(d),
            "bias": float(np.nanmean(d)),
            **_miss_numbers(Misses.from_displacements(d)),
        }


def _miss_numbers(misses: Misses) -> dict[str, float | int]:
    """Statistics of |d| [m] in `misses`, by their names in a record in JSON."""
    numbers = asdict(misses)
    return {"p95" if name == "quantile_95" else name: numbers[name] for name in numbers}


def evaluate(
    policy: Policy,
    rollout: Rollout,
    seed: Sequence[int],
    side: int,
    calls: Calls,
    meter: Meter,
) -> tuple[Evaluation, ...]:
    """Evaluate `policy` on a grid of `side` x `side` strips in each engine, by `calls`.

    Engines get the same noise and delays, of random numbers by `seed` and row.
    """
    pieces = [(engine, row) for engine in reversed(ENGINES) for row in range(side)]
    rows = _gather(
        calls, partial(_fold_row, policy, rollout, seed, side), pieces, meter
    )
    half = 0.5 * grid(side)[0].length

    evaluations = []
    for engine in ENGINES:
        d = np.array([rows[engine, row] for row in range(side)])
        misses = Misses.from_displacements(np.where(np.isnan(d), half, d))
        evaluations.append(Evaluation(engine, d, misses))
    return tuple(evaluations)


def evaluate_effects(
    policy: Policy, rollout: Rollout, segments: int, calls: Calls, meter: Meter
) -> tuple[EffectErrors, ...]:
    """Evaluate `policy` on random strips in the rod, with nothing and each effect
    hidden in turn.

    The strips are the same for every policy.
    """
    found = _gather(
        calls, partial(_fold_with, policy, rollout, segments), CONDITIONS, meter
    )
    return tuple(EffectErrors(name, found[name]) for name in CONDITIONS)


def _gather(
    calls: Calls, fold: Callable[[Key], Array], keys: Sequence[Key], meter: Meter
) -> dict[Key, Array]:
    """Displacements (n,) [m] that `fold(key)` gives for each of `keys`, by `calls`."""
    found: dict[Key, Array] = {}
    meter.begin(len(keys), 0)
    for number, displacement in calls(fold, [(key,) for key in keys]):
        found[keys[number]] = displacement
        count = f"{len(found)} of {len(keys)} pieces"
        meter.step(len(found), f"folds strips that training never folded: {count}")
    return found


def _fold_row(
    policy: Policy,
    rollout: Rollout,
    seed: Sequence[int],
    side: int,
    piece: tuple[EngineName, int],
) -> Array:
    """Displacements (side,) [m] of one row of the grid on one engine."""
    engine, row = piece
    strips = grid(side)[row * side : (row + 1) * side]
    rng = np.random.default_rng([*seed, row])
    return _displacements(
        policy, rollout, engine=stepper(engine), strips=strips, rng=rng
    )


def _fold_with(policy: Policy, rollout: Rollout, segments: int, name: str) -> Array:
    """Displacements (n,) [m] of random strips with the effect `name`."""
    rng = np.random.default_rng([EFFECTS_STREAM, CONDITIONS.index(name)])
    strips = [
        strip_under_condition(name, rng, STRIP_LENGTH) for _ in range(STRIPS_PER_EFFECT)
    ]
    return _displacements(
        policy, rollout, engine=Rod(segments, strict=False), strips=strips, rng=rng
    )


def _displacements(
    policy: Policy,
    rollout: Rollout,
    engine: Stepper,
    strips: Sequence[StripFile],
    rng: np.random.Generator,
) -> Array:
    """Displacements (n,) [m] of `strips`, folded in `engine` by `policy`; NaN without a
    touch.
    """
    models = [describe(strip) for strip in strips]
    with threadpool_limits(1, user_api="blas"):
        folds = roll_out(policy, engine, strips[0], models, settings=rollout, rng=rng)
    return folds.displacement


def tables(
    evaluations: Sequence[Evaluation], errors: Sequence[EffectErrors]
) -> Iterator[Table]:
    """Columns, rows and title of the final evaluation, and of the errors by hidden
    effect.
    """
    columns = ("mean mm", "95 % mm", "worst mm", "without a touch")
    side = len(evaluations[0].displacement)
    title = f"|d| over {side} x {side} strips of the paper's range"
    yield ("folded on", *columns), [_evaluation_row(e) for e in evaluations], title

    if errors:
        rows = [_effect_row(error) for error in errors]
        yield ("hidden", "mean d mm", *columns), rows, "d in the rod, by hidden effect"


def _evaluation_row(evaluation: Evaluation) -> tuple[str, ...]:
    """Engine, sizes of |d| [mm] and number without a touch of the final evaluation."""
    misses = evaluation.misses
    sizes = (misses.mean, misses.quantile_95, misses.worst)
    texts = (f"{1e3 * size:.1f}" for size in sizes)
    return ENGINES[evaluation.engine], *texts, str(evaluation.untouched)


def _effect_row(error: EffectErrors) -> tuple[str, ...]:
    """Effect, its mean d and sizes of |d| [mm], and number without a touch."""
    facts = error.facts()
    texts = (f"{1e3 * facts[key]:.2f}" for key in ("bias", "mean", "p95", "worst"))
    return error.effect, *texts, str(facts["untouched"])
