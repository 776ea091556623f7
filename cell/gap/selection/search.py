"""Which models are fitted, and from where: single effects, pairs jointly, three at most."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cell.gap.fitting.crossvalidation import Validated, validate
from cell.gap.fitting.gauss_newton import ROUGH_GAIN, Estimate, refit
from cell.gap.fitting.model import Evidence, Model, Point
from cell.gap.fitting.projection import projection
from cell.gap.fitting.scatter import with_scatter
from cell.gap.fitting.spreads import Spread
from cell.gap.fitting.starts import best, objective_of
from cell.gap.fitting.tasks import Simulate, Task, run_all, run_one, side_by_side
from cell.gap.selection.choice import choose, is_exhausted
from cell.gap.selection.fits import Fits
from cell.gap.selection.likelihood import ALPHA, MIN_GAIN, LikelihoodScale, margin
from cell.gap.selection.score import Score, Start, starts
from cell.gap.selection.screening import Probed, probe, ranking, table
from cell.gap.subject.subject import Candidate
from drivers.types import Array


@dataclass(frozen=True, slots=True)
class Budget:
    """How much is fitted: numbers of models, of steps, and shares of the best one's gain. Source:
    set by hand.

    So many `singles` and `pairs` are refitted, and so many models with one effect `further`, beside
    so many of the best (`beam`) that gain the share `worth` of what the best one does, from so many
    effects `looked` at there, those that promise most (`extended`). Of `sifted` pairs those
    few are chosen by a fit of `sifting` steps; starts with less than `hope` of the best one's gain
    then are given up, the others go on to `begun` steps, and to the end with `finished` of it. A
    shape parameter begins also at the share `guess` of what is believed of it, and has to gain the
    share `shapely` of what an effect has to. For each effect of the accepted model so many
    `substitutes` are fitted in its place.
    """

    singles: int = 5
    pairs: int = 3
    further: int = 4
    beam: int = 6
    worth: float = 0.3
    looked: int = 12
    extended: int = 12
    sifted: int = 8
    sifting: int = 2
    begun: int = 4
    hope: float = 0.5
    finished: float = 0.1
    guess: float = 1 / 3
    shapely: float = 0.5
    substitutes: int = 2


BUDGET = Budget()


def fit_scores(
    simulate: Simulate, fits: Fits, scores: Sequence[Score], candidates: Sequence[Candidate]
) -> Fits:
    """`fits` and the screened models, refitted with the base from null and from what the screen
    found; of those that are among `fits` only the ones that come farther.

    Models that gain far less than others are left where a few steps brought them: they are
    listed, and nothing is built on them.
    """
    tasks, base = [], fits.base.estimate
    candidates = with_shape_parameters(candidates, fits)
    for s in scores:
        known = fits.of(frozenset(s.names))
        least = known.estimate if known else base
        tasks.append(_promising(base, *starts(base, s, candidates), least))
    begun = [e for e in run_all(simulate, tasks) if e is not None]
    every = [*(m.estimate for m in fits.models), *begun]
    scale = min(e.scale for e in every)
    least_gain = BUDGET.finished * _gain(base, best(every), scale)
    found = run_all(
        simulate, [_finish(e, worth=_gain(base, e, scale) >= least_gain) for e in begun]
    )
    return fits.merge(run_all(simulate, [validate(e) for e in found]))


def shortlist(
    simulate: Simulate,
    base: Estimate,
    scores: Sequence[Score],
    candidates: Sequence[Candidate],
    most: int,
) -> list[Score]:
    """The `most` scores whose models come farthest in a few steps, to go on from there.

    Responses are far from linear where one effect of a pair moves what the other one does.
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
    """Where the first few steps from each start come."""
    return side_by_side(
        [refit(model, evidence, p, known, ROUGH_GAIN, BUDGET.sifting) for p, known in points]
    )


def _gain(base: Estimate, estimate: Estimate, scale: float) -> float:
    """Nats that `estimate` gains over the base at a dispersion."""
    return objective_of(base, scale) - objective_of(estimate, scale)


def _fit_promising(
    base: Estimate, model: Model, points: Sequence[Start], least: Estimate
) -> Task[Estimate | None]:
    """The fit of `model` that is `_promising`, to the end."""
    first = yield from _promising(base, model, points, least)
    return None if first is None else (yield from _finish(first))


def _finish(first: Estimate, *, worth: bool = True) -> Task[Estimate]:
    """The fit `first` to the end, where it is `worth` it and that is better."""
    if not worth:
        return first
    known = first.evidence
    done = yield from refit(first.model, known, first.point, first.jacobians, ROUGH_GAIN)
    return best([first, done])


def _promising(
    base: Estimate, model: Model, points: Sequence[Start], least: Estimate
) -> Task[Estimate | None]:
    """A few steps from each start, a few more from those that came far, and where they came
    farthest; None where that is not as far as the fit `least` of the same model.
    """
    known = base.evidence
    tried = yield from _few_steps(model, known, points)
    far = _farthest(base, tried, least) or ([best(tried)] if least is base else [])
    if len(far) > 1 or (far and least is not base):
        more = [
            refit(model, known, e.point, e.jacobians, ROUGH_GAIN, BUDGET.begun - BUDGET.sifting)
            for e in far
        ]
        far = [*far, *(yield from side_by_side(more))]
    if not far or (least is not base and best([least, *far]) is least):
        return None
    return best(far)


def _farthest(base: Estimate, begun: Sequence[Estimate], least: Estimate) -> list[Estimate]:
    """Those that gained over the base a good part of what the best of them, or `least`, did."""
    every = [*begun, least]
    scale = min(e.scale for e in every)
    gains = [_gain(base, e, scale) for e in every]
    most = max(gains)
    return [e for e, g in zip(begun, gains, strict=False) if g >= min(BUDGET.hope * most, most)]


def other_sign(simulate: Simulate, fits: Fits, scores: Sequence[Score]) -> list[Validated]:
    """The best single effect fitted to the end, and so from a start of the other sign if `scores`
    know one: what is stiffer here may be what is softer beside it, on another base.
    """
    singles, base = fits.of_size(1), fits.base.estimate
    known = {s.names: s.mirrored for s in scores if s.mirrored is not None}
    start = known.get(tuple(singles[0].model.names)) if singles else None
    if start is None:
        return []
    fit, model = singles[0].estimate, singles[0].model
    begin = Point(model.join(base.shared, start), base.point.local)
    tasks = [
        refit(model, fit.evidence, fit.point, fit.jacobians),
        refit(model, fit.evidence, begin),
    ]
    found = best(run_all(simulate, tasks))
    return run_all(simulate, [validate(found)])


def shape_parameters(simulate: Simulate, fits: Fits) -> list[Validated]:
    """Free the optional shape parameters of the best models; keep those that gain significantly."""
    by = fits.scale
    worth = [m for m in fits.worth(len(fits.best.model.effects)) if _has_shape(m.model)]
    tasks = []
    for m in worth:
        fit, model = m.estimate, _with_shape(m.model)
        shared, effects = fit.model.split(fit.shared)
        begin = [Point(model.join(shared, v), fit.point.local) for v in _guesses(model, effects)]
        tasks.append(_fit_promising(fit, model, [(p, None) for p in begin], fit))
    found = [e if e is not None else m.estimate
             for e, m in zip(run_all(simulate, tasks), worth, strict=True)]  # fmt: skip
    done = run_all(simulate, [validate(e) for e in found])
    return [new for m, new in zip(worth, done, strict=True) if _better(new, m, by)]


def _has_shape(model: Model) -> bool:
    return any(e.shape_parameters for e in model.effects)


def _with_shape(model: Model) -> Model:
    return replace(model, effects=tuple(e.with_shape() for e in model.effects))


def _guesses(model: Model, effects: Mapping[str, Array]) -> list[dict[str, Array]]:
    """The values with the finer parameters at their start, and off it by a share of what is
    believed of them: at the start itself some do nothing yet.
    """
    whole = {e.name: e.complete(effects[e.name]) for e in model.effects}
    moved = {}
    for e in model.effects:
        added = np.array([BUDGET.guess * p.spread for p in e.parameters])
        added[: len(effects[e.name])] = 0.0
        moved[e.name] = whole[e.name] + added
    return [whole, moved]


def _better(new: Validated, plain: Validated, by: LikelihoodScale) -> bool:
    """Whether shape parameters are earned; a shape claims less than an effect does."""
    ahead = margin(new, plain, by)
    return ahead.gain > BUDGET.shapely * by.least and ahead.p < ALPHA


def with_shape_parameters(candidates: Sequence[Candidate], fits: Fits) -> list[Candidate]:
    """The candidates, with shape parameters where a model of one effect was fitted with them."""
    known = {e.name: e for m in fits.of_size(1) for e in m.model.effects}
    return [known.get(c.name, c) for c in candidates]


def extend(
    simulate: Simulate,
    fits: Fits,
    size: int,
    candidates: Sequence[Candidate],
    probed: Sequence[Probed],
) -> Fits:
    """`fits` and the best models of `size` effects, each with the most promising further effects.

    Screened from where those models were fitted: responses to a further effect at the base,
    `probed`, mean little where another one is strong, and only say which are looked at. Only the
    best model is extended where a larger one leaves nothing: its alternatives are beside that.
    """
    beam = 1 if is_exhausted(fits) else BUDGET.beam
    scale, known = fits.scale.scale, with_shape_parameters(candidates, fits)
    found: dict[tuple[str, ...], tuple[float, Score]] = {}
    for fit in [m.estimate for m in fits.worth(size, BUDGET.worth)[:beam]]:
        about = projection(fit)
        others = [p for p in probed if p.candidate.name not in fit.model.names]
        looked = {s.names[0] for s in ranking(table(about, others))[: BUDGET.looked]}
        again = run_all(simulate, [probe(fit, c) for c in known if c.name in looked])
        before, worth = objective_of(fit, scale), (fit.scale / scale) ** 2
        for s in ranking(table(about, again))[: BUDGET.further]:
            beside = s.beside(fit)
            after = before - worth * s.gain
            if beside.names not in found or after < found[beside.names][0]:
                found[beside.names] = after, beside
    order = sorted(found.values(), key=lambda each: each[0])[: BUDGET.extended]
    scores, base = [score for _, score in order], fits.base.estimate
    if beam > 1:
        scores = shortlist(simulate, base, scores, known, BUDGET.further)
    return fit_scores(simulate, fits, scores, candidates)


def beside_base(
    simulate: Simulate, fits: Fits, base: Validated, found: Sequence[Spread], whole: Evidence
) -> Fits:
    """The models of `fits` refitted, from where they were, to the runs as another `base` has them:
    with the random unknowns `found` of the runs `whole`.
    """
    known, tasks = base.estimate.evidence, []
    for fit in (m.estimate for m in fits.models if m.model.effects):
        start = with_scatter(fit, found, whole).point
        tasks.append(refit(fit.model, known, start, _secants(fit, known), ROUGH_GAIN))
    done = run_all(simulate, [validate(e) for e in run_all(simulate, tasks)])
    return Fits((base, *done))


def _secants(fit: Estimate, known: Evidence) -> tuple[Array, ...] | None:
    """Secants of a fit, whitened as the runs of `known` are; None where those have other unknowns
    of their own.
    """
    pairs = list(zip(fit.evidence.runs, known.runs, strict=True))
    if any([p.name for p in a.local] != [p.name for p in b.local] for a, b in pairs):
        return None
    rows = zip(fit.jacobians, fit.evidence.scales, known.scales, strict=True)
    return tuple(jacobian * (had / has)[:, None] for jacobian, had, has in rows)


def without_each(fits: Fits) -> list[Score]:
    """The accepted model and the best one without each of their effects.

    Begun from where they were fitted: beside another effect a fit may have left a local minimum.
    """
    accepted, first = choose(fits).accepted, fits.best
    scores = []
    for model in [accepted] if first is accepted else [accepted, first]:
        names, fit = sorted(model.model.names), model.estimate
        if len(names) > 1:
            less = [tuple(n for n in names if n != gone) for gone in names]
            scores += [Score(kept, 0.0, {}, after=fit) for kept in less]
    return scores


def substitutes(simulate: Simulate, fits: Fits, candidates: Sequence[Candidate]) -> list[Score]:
    """The accepted model with each of its effects replaced by what, beside the others, would
    explain most in its place: of two effects much alike a search forward meets only one.
    """
    accepted, found = choose(fits).accepted, dict[tuple[str, ...], Score]()
    for gone in sorted(accepted.model.names):
        others = fits.of(accepted.model.names - {gone})
        if others is None or not others.model.effects:
            continue
        fit = others.estimate
        known = with_shape_parameters(candidates, fits)
        new = [c for c in known if c.name not in accepted.model.names]
        probed = run_all(simulate, [probe(fit, c) for c in new])
        for s in ranking(table(projection(fit), probed))[: BUDGET.substitutes]:
            beside = s.beside(fit)
            found.setdefault(beside.names, beside)
    return list(found.values())


def better_base(simulate: Simulate, fits: Fits) -> Estimate | None:
    """The base refitted from the values that the best model gave it, where that is better.

    A base that had stopped in a local minimum leaves a gap that is none.
    """
    first, base = fits.best.estimate, fits.base.estimate
    values, _ = first.model.split(first.shared)
    start = Point(values, first.point.local)
    begun = run_one(
        simulate, refit(base.model, base.evidence, start, None, ROUGH_GAIN, BUDGET.begun)
    )
    if best([base, begun]) is base:
        return None
    again = run_one(simulate, refit(base.model, base.evidence, begun.point, begun.jacobians))
    scale = min(base.scale, again.scale)
    return again if objective_of(again, scale) < objective_of(base, scale) - MIN_GAIN else None
