"""Refinement of fitted models: the other sign of an effect with a place, and shape parameters."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from cell.gap.fitting.crossvalidation import Validated, validate
from cell.gap.fitting.gauss_newton import ROUGH_GAIN, Estimate, refit
from cell.gap.fitting.model import Model, Point
from cell.gap.fitting.projection import projection
from cell.gap.fitting.starts import best
from cell.gap.fitting.tasks import Simulate, Task, run_all, side_by_side
from cell.gap.selection.fits import Fits
from cell.gap.selection.likelihood import ALPHA, MIN_GAIN, LikelihoodScale, likelihood_ratio, margin
from cell.gap.selection.screening import probe, ranking, table
from cell.gap.selection.search import BUDGET
from cell.gap.subject.subject import Candidate
from drivers.types import Array


def other_signs(simulate: Simulate, fits: Fits, models: Sequence[Validated]) -> list[Validated]:
    """Fit to the end those of `models` whose effects have a place, with the other sign of each too.

    What is stiffer here may be what is softer beside it, on another base or beside another effect.
    """
    tasks: list[Task[Estimate]] = []
    for fit in (m.estimate for m in models):
        placed = [
            e for e in fit.model.effects if e.two_sided and any(p.shape for p in e.parameters)
        ]
        beside = [(e, fits.of(fit.model.names - {e.name})) for e in placed]
        signs = [_with_other_sign(fit, e, other.estimate) for e, other in beside if other]
        if signs:
            same = refit(fit.model, fit.evidence, fit.point, fit.jacobians)
            tasks.append(_best_of([same, *signs]))
    return run_all(simulate, [validate(e) for e in run_all(simulate, tasks)])


def _best_of(tasks: Sequence[Task[Estimate]]) -> Task[Estimate]:
    """Best of several fits of a model; yields simulations."""
    return best((yield from side_by_side(tasks)))


def _with_other_sign(fit: Estimate, effect: Candidate, beside: Estimate) -> Task[Estimate]:
    """Fit of the model of `fit` with `effect` of the other sign, from where that gains most.

    It gains that `beside` the other effects, as fitted without it. Without such a place the task
    returns `fit`; yields simulations.
    """
    probed = yield from probe(beside, effect)
    score = next(iter(ranking(table(projection(beside), [probed]))), None)
    shared, known = beside.model.split(beside.shared)
    fitted = fit.model.split(fit.shared)[1][effect.name]
    for start in (score.start, score.mirrored) if score else ():
        values = (start or {}).get(effect.name, effect.null)
        if (values[0] - effect.null[0]) * (fitted[0] - effect.null[0]) < 0.0:
            at = Point(fit.model.join(shared, {**known, effect.name: values}), beside.point.local)
            return (yield from refit(fit.model, fit.evidence, at))
    return fit


def shape_parameters(simulate: Simulate, fits: Fits) -> list[Validated]:
    """Free the shape parameters of the best models; returns those that gain significantly."""
    by = fits.scale
    worth = [m for m in fits.worth(len(fits.best.model.effects)) if _has_shape(m.model)]
    tasks = []
    for m in worth:
        fit, model = m.estimate, _with_shape(m.model)
        shared, effects = fit.model.split(fit.shared)
        begin = [Point(model.join(shared, v), fit.point.local) for v in _guesses(model, effects)]
        # the start that ends lower may be the higher one after a few steps
        tasks.append(_best_of([refit(model, fit.evidence, p, None, ROUGH_GAIN) for p in begin]))
    done = run_all(simulate, [validate(e) for e in run_all(simulate, tasks)])
    return [new for m, new in zip(worth, done, strict=True) if _better(new, m, by)]


def _has_shape(model: Model) -> bool:
    return any(e.shape_parameters for e in model.effects)


def _with_shape(model: Model) -> Model:
    return replace(model, effects=tuple(e.with_shape() for e in model.effects))


def _guesses(model: Model, effects: Mapping[str, Array]) -> list[dict[str, Array]]:
    """Start values (k,) by effect, with shape parameters at their start, and a little off it.

    They are off by a share of their prior spread: at the start itself some do nothing yet.
    """
    at_start = {e.name: e.complete(effects[e.name]) for e in model.effects}
    off_start = {}
    for e in model.effects:
        added = np.array([BUDGET.shape_start * p.spread for p in e.parameters])
        added[: len(effects[e.name])] = 0.0
        off_start[e.name] = at_start[e.name] + added
    return [at_start, off_start]


def _better(new: Validated, plain: Validated, by: LikelihoodScale) -> bool:
    """Whether free shape parameters gain enough over `plain`; less is asked than of an effect."""
    ahead = margin(new, plain, by).gain > BUDGET.shape_gain * MIN_GAIN
    return ahead and likelihood_ratio(new, plain, by) < ALPHA
