"""Whether a fitted effect differs from nothing."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cell.gap.fitting import normal_equations, robust
from cell.gap.fitting.crossvalidation import Validated
from cell.gap.fitting.gauss_newton import Estimate
from cell.gap.selection.likelihood import (
    LEVEL,
    LikelihoodScale,
    Margin,
    holm,
    likelihood_scale,
    margin,
)
from cell.gap.subject.subject import Candidate
from drivers.types import Array

WIDTH = 1.96  # standard deviations of a 95 % interval
BLIND = 0.9  # of what was known before: a fit that says less says nothing


def is_significant(estimate: Estimate, effect: Candidate, by: LikelihoodScale) -> bool:
    """Whether the interval of any of its amounts excludes absence (Wald 1943).

    True where the fit says nothing of them: beyond its threshold an effect may no longer depend
    on how strong it is.
    """
    spread = np.sqrt(np.diag(normal_equations.covariance(estimate.normal())) * by.inefficiency)
    first = len(estimate.model.base)
    for other in estimate.model.effects:
        if other.name == effect.name:
            break
        first += len(other.parameters)
    for i, p in enumerate(effect.parameters, start=first):
        far = abs(estimate.shared[i] - p.start) > WIDTH * spread[i]
        if not p.shape and (far or spread[i] > BLIND * p.spread):
            return True
    return False


MATERIAL = 0.25  # of the excess gap that a step must remove


@dataclass(frozen=True, slots=True)
class Step:
    """One level of the search: its best model against what was accepted before.

    `p` is family-wise over the models of the level.
    """

    model: Validated
    before: Validated
    gain: float
    p: float
    removed: float
    accepted: bool


@dataclass(frozen=True, slots=True)
class Found:
    """The outcome: the accepted model (the base where none is), every model tried, the steps."""

    accepted: Validated
    tried: tuple[Validated, ...]
    by: LikelihoodScale
    steps: tuple[Step, ...]


def choose(pool: Sequence[Validated]) -> Found:
    """The largest model of which every effect is earned."""
    by = likelihood_scale(pool)
    accepted = next(m for m in pool if not m.model.effects)
    steps = []
    for level in (1, 2, 3):
        rivals = by_loss([m for m in pool if len(m.model.effects) == level], by)
        if not rivals:
            continue
        step = _step(rivals, accepted, pool, by)
        steps.append(step)
        if step.accepted:
            accepted = step.model
    return Found(accepted, tuple(pool), by, tuple(steps))


def _earned(
    ahead: Margin, before: Validated, pool: Sequence[Validated], by: LikelihoodScale
) -> bool:
    gain = _unfeigned(ahead.each, before, pool, by)
    return gain > by.least and ahead.p < LEVEL and ahead.removed > MATERIAL


def _step(
    rivals: Sequence[Validated], before: Validated, pool: Sequence[Validated], by: LikelihoodScale
) -> Step:
    margins = [margin(m, before, by) for m in rivals]
    p = holm([m.p for m in margins])[0]
    first = margins[0]
    good = _earned(replace(first, p=p), before, pool, by) and all(
        _needed(rivals[0], e.name, pool, by) and is_significant(rivals[0].estimate, e, by)
        for e in rivals[0].model.effects
    )
    return Step(rivals[0], before, first.gain, p, first.removed, good)


def exhausted(pool: Sequence[Validated]) -> bool:
    """Whether all that the accepted model leaves beyond noise is less than a further effect must
    gain, so that none could be accepted; in the nats of one that leaves nothing but noise, which
    is what most samples show: a generous floor leaves less than it states.
    """
    found = choose(pool)
    accepted, ideal = found.accepted, replace(found.by, scale=1.0, inefficiency=1.0)
    if not accepted.model.effects:
        return False
    noise = [0.5 * len(r) * robust.spread(r) ** 2 for r in accepted.left_out]
    left = accepted.losses(ideal.scale) - np.array(noise)
    return _unfeigned(left, accepted, pool, ideal) < ideal.least


def _needed(model: Validated, effect: str, pool: Sequence[Validated], by: LikelihoodScale) -> bool:
    """Backward check: the model without the effect, where it was tried, predicts worse."""
    without = [m for m in pool if m.model.names == model.model.names - {effect}]
    if not without or not model.model.names - {effect}:
        return True
    return _earned(margin(model, without[0], by), without[0], pool, by)


def _unfeigned(
    gains: Array, before: Validated, pool: Sequence[Validated], by: LikelihoodScale
) -> float:
    """Nats of the further `gains` (R,) that the laws of `before` cannot have left: what they get
    wrong of what they explain in a run, another effect would take up there.
    """
    if not before.model.effects:
        return float(gains.sum())
    base = next(m for m in pool if not m.model.effects)
    explained = np.maximum(margin(before, base, by).each, 0.0)
    wrong = max(e.model_error for e in before.model.effects) * explained
    return float(np.sum(gains - np.clip(gains, 0.0, wrong)))


def by_loss(models: Sequence[Validated], by: LikelihoodScale) -> list[Validated]:
    """The models, the one that predicts best first."""
    return sorted(models, key=lambda m: (float(m.losses(by.scale).sum()), m.model.name))
