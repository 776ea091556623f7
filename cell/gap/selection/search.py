"""Search over models of up to three effects: which are fitted, from which starts and shapes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cell.gap.fitting.crossvalidation import CrossValidatedFit, validate
from cell.gap.fitting.gauss_newton import ROUGH_GAIN, Estimate, refit
from cell.gap.fitting.model import Evidence, Model, Point
from cell.gap.fitting.projection import projection
from cell.gap.fitting.starts import best, objective_of
from cell.gap.fitting.tasks import Simulate, Task, run_all, side_by_side
from cell.gap.selection.choice import is_exhausted
from cell.gap.selection.fits import Fits
from cell.gap.selection.likelihood import (
    ALPHA,
    MIN_GAIN,
    LikelihoodScale,
    likelihood_ratio_p,
    margin,
)
from cell.gap.selection.screening import ProbeResponses, Score, Start, probe, ranking, starts, table
from cell.gap.subject.subject import Candidate
from drivers.types import Array


@dataclass(frozen=True, slots=True)
class Budget:
    """Effort of the search: models, steps of a fit, and shares of a gain; set by hand."""

    singles: int = 5  # models of one effect that are refitted
    pairs: int = 3  # models of two effects that are refitted
    screened_pairs: int = 8  # pairs from which those are chosen by a few steps of a fit
    beam: int = 6  # best models to which a further effect is added
    beam_share: float = 0.3  # of the best model's gain that a model in the beam has
    probed: int = 12  # effects whose response is simulated at a model of the beam
    additions: int = 4  # effects of these that are added to a model of the beam
    extensions: int = 12  # models of the whole beam with one effect added
    first_steps: int = 2  # of a fit from each start
    short_steps: int = 4  # of a fit from the best starts
    start_share: float = 0.5  # of the best start's gain, under which a start is given up
    finish_share: float = 0.1  # of the best model's gain, under which a fit is not finished
    shape_start: float = 1 / 3  # of its prior spread, where a shape parameter begins too
    shape_gain: float = 0.5  # of the gain asked of an effect, asked of shape parameters
    substitutes: int = 2  # models in which another effect replaces one that is accepted


BUDGET = Budget()


def fit_scores(
    simulate: Simulate, fits: Fits, scores: Sequence[Score], candidates: Sequence[Candidate]
) -> Fits:
    """Fit the screened models of `scores`, with the base free, and add them to `fits`.

    From null and from the values of the screen; a model that is among `fits` is kept unless it
    comes farther. Models that gain far less than others are left where a few steps brought them:
    they are listed, and nothing is built on them.
    """
    tasks, base = [], fits.base.estimate
    candidates = with_shape_parameters(candidates, fits)
    for s in scores:
        known = fits.of(frozenset(s.names))
        incumbent = known.estimate if known else None
        tasks.append(_best_short_fit(base, *starts(base, s, candidates), incumbent))
    begun = [e for e in run_all(simulate, tasks) if e is not None]
    every = [*(m.estimate for m in fits.models), *begun]
    scale = min(e.scale for e in every)
    least_gain = BUDGET.finish_share * _gain(base, best(every), scale)
    found = run_all(
        simulate, [_finish(e, promising=_gain(base, e, scale) >= least_gain) for e in begun]
    )
    return fits.merge(run_all(simulate, [validate(e) for e in found]))


def shortlist(
    simulate: Simulate,
    base: Estimate,
    scores: Sequence[Score],
    candidates: Sequence[Candidate],
    most: int,
) -> list[Score]:
    """The `most` scores whose models gain most in a few steps, with these fits to start from.

    Responses are far from linear where one effect of a pair changes the response to the other.
    """
    tasks = []
    for s in scores:
        model, points = starts(base, s, candidates)
        tasks.append(_few_steps(model, base.evidence, points[1:] or points))
    done = [best(tried) for tried in run_all(simulate, tasks)]
    scale = min((e.scale for e in done), default=1.0)
    order = sorted(range(len(done)), key=lambda i: objective_of(done[i], scale))
    return [Score(scores[i].names, scores[i].gain, {}, after=done[i]) for i in order[:most]]


def _few_steps(model: Model, evidence: Evidence, points: Sequence[Start]) -> Task[list[Estimate]]:
    """Estimates after the first few steps from each of `points`; yields simulations."""
    return side_by_side(
        [refit(model, evidence, p, known, ROUGH_GAIN, BUDGET.first_steps) for p, known in points]
    )


def _gain(base: Estimate, estimate: Estimate, scale: float) -> float:
    """Gain [nats] of `estimate` over `base` at the dispersion `scale`."""
    return objective_of(base, scale) - objective_of(estimate, scale)


def _finish(first: Estimate, *, promising: bool) -> Task[Estimate]:
    """Continue the fit `first` to its end if it is `promising`; returns the better of the two."""
    if not promising:
        return first
    known = first.evidence
    done = yield from refit(first.model, known, first.point, first.jacobians, ROUGH_GAIN)
    return best([first, done])


def _best_short_fit(
    base: Estimate, model: Model, points: Sequence[Start], incumbent: Estimate | None = None
) -> Task[Estimate | None]:
    """Best fit of `model` after a few steps from each start; yields simulations.

    None where it is no better than `incumbent`, an earlier fit of the same model.
    """
    known = base.evidence
    tried = yield from _few_steps(model, known, points)
    far = _farthest(base, tried, base if incumbent is None else incumbent)
    if incumbent is None and not far:
        far = [best(tried)]
    if len(far) > 1 or (far and incumbent is not None):
        more = [
            refit(
                model,
                known,
                e.point,
                e.jacobians,
                ROUGH_GAIN,
                BUDGET.short_steps - BUDGET.first_steps,
            )
            for e in far
        ]
        far = [*far, *(yield from side_by_side(more))]
    if incumbent is not None and (not far or best([incumbent, *far]) is incumbent):
        return None
    return best(far)


def _farthest(base: Estimate, begun: Sequence[Estimate], known: Estimate) -> list[Estimate]:
    """Those of `begun` that gain a good part of the largest gain over `base`, of `known` too."""
    every = [*begun, known]
    scale = min(e.scale for e in every)
    gains = [_gain(base, e, scale) for e in every]
    most = max(gains)
    least = min(BUDGET.start_share * most, most)
    return [e for e, gain in zip(begun, gains, strict=False) if gain >= least]


def with_shape_parameters(candidates: Sequence[Candidate], fits: Fits) -> list[Candidate]:
    """Candidates, with shape parameters free where a model of one effect was fitted so."""
    known = {e.name: e for m in fits.of_size(1) for e in m.model.effects}
    return [known.get(c.name, c) for c in candidates]


def extend(
    simulate: Simulate,
    fits: Fits,
    size: int,
    candidates: Sequence[Candidate],
    probed: Sequence[ProbeResponses],
) -> Fits:
    """Fit the best models of `size` effects with one further effect each, and add them to `fits`.

    Only the best model is extended where a larger one leaves nothing: its alternatives are beside
    that. `probed` are responses at the base.
    """
    beam = 1 if is_exhausted(fits) else BUDGET.beam
    scale, known = fits.scale.scale, with_shape_parameters(candidates, fits)
    expected: dict[tuple[str, ...], tuple[float, Score]] = {}
    for fit in [m.estimate for m in fits.near_best(size, BUDGET.beam_share)[:beam]]:
        before, unit = objective_of(fit, scale), (fit.scale / scale) ** 2
        screened = _screen_further(simulate, fit, known, probed, fits.immaterial)
        for s in screened[: BUDGET.additions]:
            joint = s.joined_to(fit)
            after = before - unit * s.gain
            if joint.names not in expected or after < expected[joint.names][0]:
                expected[joint.names] = after, joint
    order = sorted(expected.values(), key=lambda each: each[0])[: BUDGET.extensions]
    scores = [score for _, score in order]
    if beam > 1:
        scores = shortlist(simulate, fits.base.estimate, scores, known, BUDGET.additions)
    return fit_scores(simulate, fits, scores, candidates)


def extend_where_shown(
    simulate: Simulate,
    fits: Fits,
    models: Sequence[CrossValidatedFit],
    candidates: Sequence[Candidate],
    probed: Sequence[ProbeResponses],
) -> Fits:
    """Fit `models` with each further effect that the screen beside them clearly shows.

    Along one response a test is sharper than over all residuals (score test: Rao 1948, Proc. Camb.
    Phil. Soc. 44, 50): runs without a gap as a whole may still hold a small effect. `probed` are
    responses at the base.
    """
    by, scores = fits.scale, []
    known = with_shape_parameters(candidates, fits)
    for fit in (m.estimate for m in models):
        least = MIN_GAIN * by.inefficiency * (by.scale / fit.scale) ** 2
        found = _screen_further(simulate, fit, known, probed, fits.immaterial)
        scores += [s.joined_to(fit) for s in found[: BUDGET.additions] if s.gain > least]
    return fit_scores(simulate, fits, scores, candidates)


def _screen_further(
    simulate: Simulate,
    fit: Estimate,
    candidates: Sequence[Candidate],
    probed: Sequence[ProbeResponses],
    immaterial: Sequence[Array],
) -> list[Score]:
    """Scores of the effects to add to `fit`, probed at its values, the largest gain first.

    Beside `immaterial` amounts of all effects, whose responses (N, k) these are.
    """
    about = projection(fit, nuisance=immaterial)
    # responses at the base mean little beside a strong effect: they only choose what is probed
    others = [p for p in probed if p.candidate.name not in fit.model.names]
    looked = {s.names[0] for s in ranking(table(about, others))[: BUDGET.probed]}
    again = run_all(simulate, [probe(fit, c) for c in candidates if c.name in looked])
    return ranking(table(about, again))


def without_each(fits: Fits, accepted: CrossValidatedFit) -> list[Score]:
    """Scores of the `accepted` and of the best model, each without one of its effects.

    Fits start from their values: beside another effect a fit may have left a local minimum.
    """
    scores = []
    for model in [accepted] if fits.best is accepted else [accepted, fits.best]:
        names, fit = sorted(model.model.names), model.estimate
        if len(names) > 1:
            subsets = [tuple(n for n in names if n != gone) for gone in names]
            scores += [Score(subset, 0.0, {}, after=fit) for subset in subsets]
    return scores


def substitutes(
    simulate: Simulate, fits: Fits, accepted: CrossValidatedFit, candidates: Sequence[Candidate]
) -> list[Score]:
    """Scores of the `accepted` model with each effect replaced by its best substitutes.

    Only effects that were not fitted in its place are considered: of two similar ones a forward
    search meets only one.
    """
    found = dict[tuple[str, ...], Score]()
    for gone in sorted(accepted.model.names):
        others = fits.of(accepted.model.names - {gone})
        if others is None or not others.model.effects:
            continue
        fit = others.estimate
        known = with_shape_parameters(candidates, fits)
        absent = [c for c in known if c.name not in accepted.model.names]
        new = [c for c in absent if fits.of(others.model.names | {c.name}) is None]
        probed = run_all(simulate, [probe(fit, c) for c in new])
        for s in ranking(table(projection(fit), probed))[: BUDGET.substitutes]:
            joint = s.joined_to(fit)
            found.setdefault(joint.names, joint)
    return list(found.values())


def other_signs(
    simulate: Simulate, fits: Fits, models: Sequence[CrossValidatedFit]
) -> list[CrossValidatedFit]:
    """Fit to the end those of `models` whose effects have a place, with the other sign of each too.

    A stiff seam here resembles a soft one next to it, on another base or beside another effect.
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


def shape_parameters(simulate: Simulate, fits: Fits) -> list[CrossValidatedFit]:
    """Free the shape parameters of the best models; returns those that gain significantly."""
    by = fits.scale
    best_models = [m for m in fits.near_best(len(fits.best.model.effects)) if _has_shape(m.model)]
    tasks = []
    for m in best_models:
        fit, model = m.estimate, _with_shape(m.model)
        shared, effects = fit.model.split(fit.shared)
        begin = [Point(model.join(shared, v), fit.point.local) for v in _guesses(model, effects)]
        # the start that ends lower may be the higher one after a few steps
        tasks.append(_best_of([refit(model, fit.evidence, p, None, ROUGH_GAIN) for p in begin]))
    done = run_all(simulate, [validate(e) for e in run_all(simulate, tasks)])
    return [new for m, new in zip(best_models, done, strict=True) if _better(new, m, by)]


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


def _better(new: CrossValidatedFit, plain: CrossValidatedFit, by: LikelihoodScale) -> bool:
    """Whether free shape parameters gain enough over `plain`; less is asked than of an effect."""
    ahead = margin(new, plain, by).gain > BUDGET.shape_gain * MIN_GAIN
    return ahead and likelihood_ratio_p(new, plain, by) < ALPHA
