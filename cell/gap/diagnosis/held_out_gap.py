"""Residuals of models on held-out runs, before and after effects were accepted."""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cell.gap.fitting import Simulate, robust, run_one
from cell.gap.fitting.gauss_newton import FitEstimate, refit
from cell.gap.fitting.model import Model, stated
from cell.gap.subject.subject import FitRun, Quantity, Words
from drivers.base.types import Array

ODD = 3.0  # times as far off as others, beyond what noise does; set by hand
DRAWS = 2000  # of runs, for the interval of the shrink; set by hand


class Shrink(NamedTuple):
    """Fraction by which a model reduces the excess residual of held-out runs, with its
    95 % confidence interval `low` to `high`.
    """

    value: float
    low: float
    high: float


def fit_held_out(
    simulate: Simulate, held: Model, runs: Sequence[FitRun]
) -> FitEstimate:
    """Fit a model to held-out `runs`: its shared values stay fixed at those of `held`,
    only the runs' own unknowns are free.
    """
    return run_one(simulate, refit(held, runs, stated(runs, np.zeros(0))))


def floor(
    runs: Sequence[FitRun], quantities: Mapping[str, Quantity]
) -> dict[str, float]:
    """Root mean square measurement noise of each displayed quantity, by its key: the
    residual that a perfect model leaves.
    """
    readings = [run.samples.reading**2 for run in runs]
    return _display_gaps(runs, readings, quantities)


def _mean_by_word(words: Words, square: Array) -> dict[str, float]:
    """Mean of the finite values of `square` (n,) for each distinct word of `words`
    (n,), such as a channel's name.
    """
    known = np.isfinite(square)
    return {
        str(name): square[known & (words == name)].mean()
        for name in np.unique(words[known])
    }


def _display_gaps(
    runs: Sequence[FitRun],
    squares_by_run: Sequence[Array],
    quantities: Mapping[str, Quantity],
) -> dict[str, float]:
    """Root mean square residual of each displayed quantity, by its key and in its unit,
    from the squared residuals (samples,) of each run.
    """
    squares: dict[str, list[float]] = defaultdict(list)
    for run, square in zip(runs, squares_by_run, strict=True):
        for name, mean in _mean_by_word(run.samples.quantity, square).items():
            squares[name].append(mean)

    gaps = {}
    for name, means in squares.items():
        quantity = quantities[name]
        if quantity.key:
            gaps[quantity.key] = quantity.factor * np.sqrt(np.mean(means))
    return gaps


def run_squares(estimate: FitEstimate) -> Array:
    """Mean square whitened residual (R,) of each run, with equal weight for each
    channel.
    """
    pairs = zip(estimate.runs, estimate.residuals, strict=True)
    channels = [_mean_by_word(run.samples.channel, r**2) for run, r in pairs]
    return np.array([np.mean([*squares.values()]) for squares in channels])


def excess(squares: Array) -> Array:
    """Excess residual (...) in units of noise, sqrt(max(mean - 1, 0)), from the mean
    squares (..., runs) of whitened residuals.
    """
    beyond: Array = np.sqrt(np.maximum(squares.mean(axis=-1) - 1.0, 0.0))
    return beyond


def excess_of(estimate: FitEstimate) -> float:
    """Excess residual [noise] of a fit over all its runs: sqrt(max(mean square - 1,
    0)).
    """
    return float(excess(run_squares(estimate)))


def excess_by_quantity(
    estimate: FitEstimate, quantities: Mapping[str, Quantity]
) -> dict[str, float]:
    """Excess residual of a fit, in units of noise, for each displayed quantity by its
    key.
    """
    shown = _display_gaps(estimate.runs, [r**2 for r in estimate.residuals], quantities)
    units = {quantity.key: quantity.factor for quantity in quantities.values()}
    return {
        key: max((rms / units[key]) ** 2 - 1.0, 0.0) ** 0.5
        for key, rms in shown.items()
    }


def bounded_excess(estimate: FitEstimate) -> float:
    """Excess residual [noise] of a fit, with outliers clipped at multiples of its
    dispersion.
    """
    scale = robust.scale(estimate.stacked_residuals)
    clipped = [robust.bound(r, scale) for r in estimate.residuals]
    return excess_of(replace(estimate, residuals=clipped))


def sizes(
    estimate: FitEstimate, quantities: Mapping[str, Quantity]
) -> dict[str, float]:
    """Root mean square residual of a fit for each displayed quantity, and its total
    excess residual in units of noise.
    """
    rms = _display_gaps(estimate.runs, [raw.square for raw in estimate.raw], quantities)
    return {**rms, "excess": excess_of(estimate)}


def rms_by_run(
    estimate: FitEstimate, quantities: Mapping[str, Quantity]
) -> list[float]:
    """Root mean square residual of each run, in units of noise, model error and
    tolerance.

    A true model leaves about 1 in these units, by which outliers are bounded. Channels
    weigh alike.
    """
    bounded = []
    for run, r in zip(estimate.runs, estimate.residuals, strict=True):
        samples = run.samples
        scale = samples.scale
        tolerance = [quantities[str(name)].tolerance for name in samples.quantity]
        bounded.append(robust.bound(r * scale / np.hypot(scale, tolerance)))
    return [*np.sqrt(run_squares(replace(estimate, residuals=bounded)))]


def odd_runs(
    estimate: FitEstimate, quantities: Mapping[str, Quantity]
) -> Iterator[str]:
    """Words on each run that a fit leaves ODD times as far off as it leaves the others,
    where it leaves most of them at their noise.
    """
    rms = np.array(rms_by_run(estimate, quantities))
    usual = max(1.0, np.median(rms))
    for run, each in zip(estimate.runs, rms, strict=True):
        if len(rms) > 2 and usual < ODD and each > ODD * usual:
            yield (
                f"{run.name}: contradicts the others: it is left {each:.1f} sigma off,"
                f" they {usual:.1f}; look what was different, or leave it out"
            )


def shrink(before: FitEstimate, after: FitEstimate, rng: np.random.Generator) -> Shrink:
    """Fraction of the excess residual that a fit `after` removes from that `before`,
    with a bootstrap interval (Efron 1979).
    """
    squares = [*map(run_squares, (before, after))]
    count = len(before.runs)
    drawn = rng.integers(0, count, (DRAWS, count))
    shares = _share_closed(*(by_run[drawn] for by_run in squares))
    value = float(_share_closed(*squares))
    return Shrink(value, *np.quantile(shares, [0.025, 0.975]))


def _share_closed(before: Array, after: Array) -> Array:
    """Fraction (...) of the excess residual removed, from mean squares (..., runs)
    `before` and `after`; 0 where there was no excess.
    """
    gap = excess(before)
    is_gap = gap > 0.0
    return np.where(is_gap, 1.0 - excess(after) / np.where(is_gap, gap, 1.0), 0.0)
