"""Choice of the accepted model: forward selection with a test of every effect."""

from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from cell.gap.fitting import robust
from cell.gap.fitting.crossvalidation import Validated
from cell.gap.fitting.gauss_newton import Estimate
from cell.gap.fitting.uncertainty import covariance
from cell.gap.selection.fits import Fits
from cell.gap.selection.likelihood import ALPHA, MIN_GAIN, LikelihoodScale, Margin, holm, margin
from cell.gap.selection.posterior import Posterior
from cell.gap.subject.subject import Candidate
from drivers.types import Array


@dataclass(frozen=True, slots=True)
class Earned:
    """Thresholds by which an effect is accepted, as shares. Source: set by hand.

    It must remove the share `removed` of the excess gap. A fit does not determine an amount whose
    standard deviation stays above the share `blind` of its prior spread.
    """

    removed: float = 0.25
    blind: float = 0.9


EARNED = Earned()


def is_significant(estimate: Estimate, effect: Candidate, by: LikelihoodScale) -> bool:
    """Whether the 95 % interval of any amount of `effect` excludes its absence (Wald 1943).

    True, too, where the fit does not determine an amount: beyond its threshold an effect may no
    longer depend on how strong it is.
    """
    sigma = np.sqrt(np.diag(covariance(estimate, by.inefficiency)))
    _, values = estimate.model.split(estimate.shared)
    _, sigmas = estimate.model.split(sigma)
    rows = zip(effect.parameters, values[effect.name], sigmas[effect.name], strict=True)
    return any(
        abs(value - p.start) > special.ndtri(0.975) * error or error > EARNED.blind * p.spread
        for p, value, error in rows
        if not p.shape
    )


@dataclass(frozen=True, slots=True)
class Step:
    """One level of the search: its best model compared with the model accepted before.

    `gain` [nats] on runs left out; `p` is family-wise over the models of the level; `removed` is
    the share of the excess gap that the level removes.
    """

    model: Validated
    before: Validated
    gain: float
    p: float
    removed: float
    accepted: bool


@dataclass(frozen=True, slots=True)
class Choice:
    """Outcome of the search: the accepted model (the base where none is), all fits, the steps.

    `by` is the scale on which all of them were compared.
    """

    accepted: Validated
    fits: Fits
    by: LikelihoodScale
    steps: tuple[Step, ...]


def choose(fits: Fits, sets: Posterior | None = None) -> Choice:
    """Forward selection with a backward check: the largest model of which each effect is earned.

    An effect is there where the interval of an amount excludes absence, or where the evidence is
    for it: no interval shows an amount for which another number makes up, as a place for a mass.
    """
    by, accepted = fits.scale, fits.base
    steps = []
    for size in (1, 2, 3):
        if not fits.of_size(size):
            continue
        step = _step(fits, size, accepted, by, sets)
        steps.append(step)
        if step.accepted:
            accepted = step.model
    return Choice(accepted, fits, by, tuple(steps))


def by_evidence(choice: Choice, sets: Posterior) -> Choice:
    """Accept no set less probable than the base, but the most probable one that clearly leads it.

    That one also where margins accept none: a margin must exceed all that the model's error could
    imitate in the direction of an effect; the posterior has that error in every direction, beside
    each set.
    """
    fits, best = choice.fits, choice.fits.of(sets.models[0].names)
    if sets.lead(choice.accepted.model.names) > 0.0:
        return choice
    steps = tuple(replace(step, accepted=False) for step in choice.steps)
    if best is None or sets.lead(best.model.names) < MIN_GAIN:
        return replace(choice, accepted=fits.base, steps=steps)
    ahead = margin(best, fits.base, choice.by)
    step = Step(best, fits.base, ahead.gain, ahead.p, ahead.removed, accepted=True)
    return replace(choice, accepted=best, steps=(*steps, step))


def _is_earned(ahead: Margin, before: Validated, fits: Fits, by: LikelihoodScale) -> bool:
    """Whether the margin `ahead` of `before` is enough to accept a model."""
    gain = _beyond_model_error(ahead.each, before, fits, by)
    return gain > by.least and ahead.p < ALPHA and ahead.removed > EARNED.removed


def _step(
    fits: Fits, size: int, before: Validated, by: LikelihoodScale, sets: Posterior | None
) -> Step:
    """Compare the best model of `size` effects with the one accepted `before`."""
    models = fits.of_size(size)
    margins = [margin(m, before, by) for m in models]
    p = holm([m.p for m in margins])[0]
    best, ahead = models[0], margins[0]
    accepted = _is_earned(replace(ahead, p=p), before, fits, by) and all(
        _is_needed(best, e.name, fits, by)
        and (is_significant(best.estimate, e, by) or _evident(best, e.name, by, sets))
        for e in best.model.effects
    )
    return Step(best, before, ahead.gain, p, ahead.removed, accepted)


def is_exhausted(fits: Fits) -> bool:
    """Whether the accepted model leaves less than a further effect would have to gain.

    On the likelihood scale of a model that leaves nothing but noise, as most samples show it: a
    generous floor leaves less than it states.
    """
    choice = choose(fits)
    accepted, ideal = choice.accepted, replace(choice.by, scale=1.0, inefficiency=1.0)
    if not accepted.model.effects:
        return False
    noise = [0.5 * len(r) * robust.spread(r) ** 2 for r in accepted.left_out]
    left = accepted.losses(ideal.scale) - np.array(noise)
    return _beyond_model_error(left, accepted, fits, ideal) < ideal.least


def _is_needed(model: Validated, effect: str, fits: Fits, by: LikelihoodScale) -> bool:
    """Backward check: whether `model` predicts worse without `effect`, where that was fitted."""
    others = model.model.names - {effect}
    without = fits.of(others)
    if without is None or not others:
        return True
    return _is_earned(margin(model, without, by), without, fits, by)


def _evident(model: Validated, effect: str, by: LikelihoodScale, sets: Posterior | None) -> bool:
    """Whether the posterior clearly favours `model` over itself without `effect`."""
    return sets is not None and sets.gain(model.model.names, effect) > by.least


def _beyond_model_error(gains: Array, before: Validated, fits: Fits, by: LikelihoodScale) -> float:
    """Sum of `gains` (R,) [nats] less the part that errors of the laws of `before` may explain.

    What a law gets wrong of what it explains in a run, another effect would absorb there.
    """
    if not before.model.effects:
        return float(gains.sum())
    explained = np.maximum(margin(before, fits.base, by).each, 0.0)
    wrong = max(e.model_error for e in before.model.effects) * explained
    return float(np.sum(gains - np.clip(gains, 0.0, wrong)))
