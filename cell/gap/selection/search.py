"""Search over models of up to three effects: which are fitted, and from which
values.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from operator import itemgetter
from typing import NamedTuple

import numpy as np

from cell.gap.fitting import Simulate, Task, run_all, side_by_side
from cell.gap.fitting.base_fit import projection
from cell.gap.fitting.crossvalidation import CrossValidatedFit, validate
from cell.gap.fitting.gauss_newton import ROUGH_GAIN, FitEstimate, best, refit
from cell.gap.fitting.model import Model, Point
from cell.gap.selection.likelihood import (
    ALPHA,
    MIN_GAIN,
    Fits,
    gain,
    likelihood_ratio_p,
)
from cell.gap.selection.posterior import spike_responses
from cell.gap.selection.screening import (
    ProbeResponses,
    Score,
    Start,
    fit_starts,
    probe_equations,
    ranked_singles,
    run_probes,
)
from cell.gap.subject.subject import Candidate, FitRun


class Budget(NamedTuple):
    """Effort of the search, set by hand: numbers of models and steps, and limits of
    gains.
    """

    singles: int = 5  # models of one effect that are refitted
    screened_pairs: int = 8  # pairs that are looked at more closely
    beam: int = 4  # best models to which a further effect is added
    probed: int = 12  # effects whose response is simulated at a model of the beam
    additions: int = 4  # effects of these that are added to a model of the beam
    first_steps: int = 2  # of a fit from each start
    short_steps: int = 4  # of a fit from the best starts
    # nats by which a fit that is not finished may be behind the best
    reach: float = 20.0
    share: float = 0.5  # of the best gain that such a fit may have instead
    # of its prior spread, where a shape parameter begins too
    shape_start: float = 1 / 3
    shape_gain: float = 0.5  # of the gain asked of an effect, asked of shape parameters


BUDGET = Budget()


def within_reach(gain: float, most: float) -> bool:
    """Whether an unfinished fit of `gain` [nats] may still reach the gain `most`
    [nats].
    """
    return gain >= min(BUDGET.share * most, most - BUDGET.reach)


@dataclass(frozen=True, slots=True)
class Search:
    """Search that fits models of `candidates`, whose responses at the base are
    `probed`.
    """

    simulate: Simulate
    candidates: Sequence[Candidate]
    probed: Sequence[ProbeResponses]

    def fit_scored_models(self, fits: Fits, scores: Sequence[Score]) -> Fits:
        """Copy of `fits` with the models of `scores`, each fitted along with the base.

        Each fit starts at null and at the values of the screen; it replaces a fit of
        the same model only if it gains more. Models that gain far less than the best
        after a few steps are not refined: the verdict may list them, but no model
        extends them.
        """
        base = fits.base
        simulate = self.simulate
        candidates = self._with_shape_parameters(fits)
        tasks = []
        for score in scores:
            earlier = fits.of(frozenset(score.names))
            model, points = fit_starts(base, score, candidates)
            tasks.append(_best_short_fit(base, model, points, incumbent=earlier))
        started = [e for e in run_all(simulate, tasks) if e]
        estimates = [*fits.models, *started]
        dispersion = min(estimate.scale for estimate in estimates)
        largest = _gain_over(base, best(estimates), dispersion)

        def refined(fit: FitEstimate) -> Task[FitEstimate]:
            nats = _gain_over(base, fit, dispersion)
            return _finish(fit, promising=within_reach(nats, largest))

        finished = run_all(simulate, [*map(refined, started)])
        return fits.merge(run_all(simulate, [*map(validate, finished)]))

    def extend(self, fits: Fits, models: Sequence[CrossValidatedFit]) -> Fits:
        """Copy of `fits` with one more effect added to `models`, chosen by a linear
        screen.

        Along one response a test is sharper than over all residuals (score test: Rao
        1948, Proc. Camb. Phil. Soc. 44, 50): runs without a gap as a whole may still
        hold a small effect.
        """
        likelihood = fits.likelihood
        expected: dict[tuple[str, ...], tuple[float, Score]] = {}
        for fit in models:
            before = fit.objective_at(likelihood.scale)
            unit = (fit.scale / likelihood.scale) ** 2
            for score in self._screen_further(fits, fit):
                joint = score.joined_to(fit)
                nats = unit * score.gain
                names = joint.names
                after = before - nats
                is_new = not fits.of(frozenset(names))
                promises = nats > MIN_GAIN * likelihood.inefficiency
                leads = names not in expected or after <= expected[names][0]
                if is_new and promises and leads:
                    expected[names] = (after, joint)

        order = sorted(expected.values(), key=itemgetter(0))
        scores = [score for _, score in order[: BUDGET.additions * len(models)]]
        if len(models) > 1:
            free = self._with_shape_parameters(fits)
            scores = self.shortlist(fits.base, scores, free, BUDGET.additions)

        return self.fit_scored_models(fits, scores)

    def shortlist(
        self,
        base: FitEstimate,
        scores: Sequence[Score],
        candidates: Sequence[Candidate],
        most: int,
    ) -> list[Score]:
        """The `most` scores whose models gain most in a few steps of their fit.

        The linear screen misjudges a pair where one effect changes the response to the
        other. The scores returned start from these short fits.
        """
        tasks = []
        for score in scores:
            model, points = fit_starts(base, score, candidates)
            tasks.append(_few_steps(model, base.runs, points[1:] or points))

        estimates = [best(tried) for tried in run_all(self.simulate, tasks)]
        dispersion = min((e.scale for e in estimates), default=1.0)
        pairs = zip(scores, estimates, strict=True)
        order = sorted(pairs, key=lambda each: each[1].objective_at(dispersion))
        return [
            Score(s.names, s.gain, {}, origin=estimate) for s, estimate in order[:most]
        ]

    def other_signs(self, fits: Fits, models: Sequence[CrossValidatedFit]) -> Fits:
        """Copy of `fits` with `models` refitted by other signs of two-sided effects
        with a place.

        A stiff seam here resembles a soft one next to it, on another base or beside
        another effect.
        """
        tasks = []
        for model in models:
            for effect in model.effects:
                beside = fits.of(model.names - {effect.name})
                is_placed = not all(p.is_amount for p in effect.parameters)
                if beside and is_placed and effect.two_sided:
                    tasks.append(_with_other_sign(model, effect, beside))
        finished = [e for e in run_all(self.simulate, tasks) if e]
        return fits.merge(run_all(self.simulate, [*map(validate, finished)]))

    def free_shapes(self, fits: Fits) -> list[CrossValidatedFit]:
        """Best models refitted with free shape parameters, if that gains significantly.

        These fits go on to the end: a rough one stops short of the gain that is asked
        of them.
        """
        near_best = fits.near_best(len(fits.best.effects))
        plain = [
            m for m in near_best if any(effect.shape_parameters for effect in m.effects)
        ]
        ends = run_all(self.simulate, [_with_free_shape(m) for m in plain])
        validated = run_all(self.simulate, [*map(validate, ends)])
        likelihood = fits.likelihood
        least = BUDGET.shape_gain * MIN_GAIN
        return [
            free
            for free, fixed in zip(validated, plain, strict=True)
            if gain(free, fixed, likelihood) > least
            and likelihood_ratio_p(free, fixed, likelihood) < ALPHA
        ]

    def _with_shape_parameters(self, fits: Fits) -> list[Candidate]:
        """Candidate effects, with free shape parameters if a model of one effect was
        fitted so.
        """
        fitted = {
            effect.name: effect for model in fits.of_size(1) for effect in model.effects
        }
        return [fitted.get(candidate.name, candidate) for candidate in self.candidates]

    def _screen_further(self, fits: Fits, fit: FitEstimate) -> list[Score]:
        """Scores of the effects to add to `fit`, probed at its values, the largest gain
        first.

        Responses at the base mean little beside a strong effect: by them, the most
        promising effects are chosen, and the values at which each is probed. Those with
        a threshold, which lies elsewhere beside another effect, are probed and begun at
        all stated values.
        """
        beside = projection(fit, nuisance=spike_responses(fits.library))
        others = [p for p in self.probed if p.name not in fit.names]
        ranked = ranked_singles(probe_equations(beside, others))[: BUDGET.probed]
        promising = {score.names[0]: score for score in ranked}
        thresholds = {p.name for p in others if p.has_threshold}

        tasks = []
        for c in self._with_shape_parameters(fits):
            if score := promising.get(c.name):
                probes = c.probes if c.name in thresholds else _probe_at_start(c, score)
                tasks.append(run_probes(fit, replace(c, probes=probes)))

        scores = ranked_singles(probe_equations(beside, run_all(self.simulate, tasks)))
        return [
            s if s.names[0] in thresholds else replace(s, probe_starts=())
            for s in scores
        ]


def _few_steps(
    model: Model,
    runs: Sequence[FitRun],
    points: Sequence[Start],
    steps: int = BUDGET.first_steps,
) -> Task[list[FitEstimate]]:
    """Estimates after the first few `steps` from each of `points`; yields simulation
    requests.
    """
    return side_by_side([refit(model, runs, *p, ROUGH_GAIN, steps) for p in points])


def _gain_over(base: FitEstimate, estimate: FitEstimate, scale: float) -> float:
    """Gain [nats] of `estimate` over `base` at the dispersion `scale`."""
    return base.objective_at(scale) - estimate.objective_at(scale)


def _finish(first: FitEstimate, *, promising: bool) -> Task[FitEstimate]:
    """Continue the fit `first` to its end if it is `promising`; returns the better of
    the two.
    """
    if not promising:
        return first
    finished = yield from refit(
        first.model,
        first.runs,
        start=first.point,
        jacobians=first.jacobians,
        enough=ROUGH_GAIN,
    )
    return best([first, finished])


def _best_short_fit(
    base: FitEstimate,
    model: Model,
    points: Sequence[Start],
    incumbent: FitEstimate | None = None,
) -> Task[FitEstimate | None]:
    """Best fit of `model` after a few steps from each start; yields simulation
    requests.

    None where it is no better than `incumbent`, an earlier fit of the same model.
    """
    runs = base.runs
    estimates = yield from _few_steps(model, runs, points)
    promising = _nearly_best(base, estimates, incumbent or base)
    if not incumbent:
        promising = promising or [best(estimates)]
    elif not promising:
        return None

    if incumbent or len(promising) > 1:
        more = BUDGET.short_steps - BUDGET.first_steps
        points = [(e.point, e.jacobians) for e in promising]
        promising += yield from _few_steps(model, runs, points, more)

    if incumbent and best([incumbent, *promising]) is incumbent:
        return None

    return best(promising)


def _nearly_best(
    base: FitEstimate, begun: Sequence[FitEstimate], reference: FitEstimate
) -> list[FitEstimate]:
    """Unfinished fits `begun` that gain nearly most over `base`, `reference`
    included.
    """
    estimates = [*begun, reference]
    dispersion = min(estimate.scale for estimate in estimates)
    gains = [_gain_over(base, estimate, dispersion) for estimate in estimates]
    in_reach = [gain >= BUDGET.share * max(gains) for gain in gains]
    return [e for e, promising in zip(begun, in_reach, strict=False) if promising]


def _probe_at_start(
    candidate: Candidate, score: Score
) -> tuple[tuple[tuple[float, ...], ...], ...]:
    """Probe of `candidate` where `score` would start a fit; none where it has no effect
    there.
    """
    values = candidate.complete(score.start.get(candidate.name, candidate.null))
    if np.array_equal(values, candidate.null):
        return ()
    return ((tuple(map(float, values)),),)


def without_each(accepted: CrossValidatedFit) -> list[Score]:
    """Scores of the models that lack one effect of `accepted`, to be fitted from its
    values.

    Beside another effect a fit may have left a local minimum.
    """
    names = accepted.names
    subsets = [tuple(sorted(names - {gone})) for gone in sorted(names)]
    return [Score(subset, gain=0.0, start={}, origin=accepted) for subset in subsets]


def _with_other_sign(
    fit: FitEstimate, effect: Candidate, beside: FitEstimate
) -> Task[FitEstimate | None]:
    """Fit with the other sign of `effect` than `fit`, started where that gains most.

    It gains that `beside` the other effects, as fitted without it. None without such a
    place, or where the fit comes no farther; yields simulations.
    """
    probed = yield from run_probes(beside, effect)
    name = effect.name
    null = effect.null
    shared, others = beside.values
    _, fitted = fit.values
    side = fitted[name][0] - null[0]

    starts: list[Start] = []
    for score in ranked_singles(probe_equations(projection(beside), [probed])):
        for start in (score.start, score.opposite_sign or {}):
            values = start.get(name, null)
            if (values[0] - null[0]) * side < 0.0:
                joint = fit.model.join(shared, {**others, name: values})
                starts.append((Point(joint, beside.local), None))

    if not starts:
        return None

    started = yield from _best_short_fit(beside, fit.model, starts, fit)
    return (yield from _finish(started, promising=True)) if started else None


def _with_free_shape(fit: FitEstimate) -> Task[FitEstimate]:
    """Fit of the model of `fit` with free shape parameters; yields simulation requests.

    They begin off their start by a share of their prior spread: at it some do nothing
    yet.
    """
    model = replace(
        fit.model, effects=tuple(effect.with_shape() for effect in fit.effects)
    )
    shared, fixed = fit.values
    values = {}
    for e in model.effects:
        known = fixed[e.name]
        off_start = np.array([BUDGET.shape_start * p.spread for p in e.parameters])
        off_start[: len(known)] = 0.0
        values[e.name] = e.complete(known) + off_start
    start = Point(model.join(shared, values), fit.local)
    return (yield from refit(model, fit.runs, start))
