"""Choice of the accepted model, and the models that these runs cannot distinguish from it.

Accepted is the most probable set of effects of which each is needed.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cell.gap.fitting import robust
from cell.gap.fitting.crossvalidation import CrossValidatedFit
from cell.gap.selection.fits import Fits
from cell.gap.selection.likelihood import ALPHA, MIN_GAIN, LikelihoodScale, margin
from cell.gap.selection.posterior import Posterior
from drivers.types import Array


@dataclass(frozen=True, slots=True)
class Choice:
    """The accepted model, the base where none is, and all fits."""

    accepted: CrossValidatedFit
    fits: Fits


def choose(fits: Fits, sets: Posterior) -> Choice:
    """Accept the most probable model of which each effect is needed; else the base."""
    return Choice(next(needed_models(fits, sets), fits.base), fits)


def needed_models(fits: Fits, sets: Posterior) -> Iterator[CrossValidatedFit]:
    """Models of which each effect is needed, the most probable first.

    A model clearly leads each fitted part of it, the base too, and predicts runs left out better:
    what a fit gains in its own runs, others may not confirm. Beside other effects it predicts them
    clearly better than errors of their laws allow.
    """

    def leads(model: CrossValidatedFit, part: CrossValidatedFit) -> bool:
        lead = sets.lead(model.model.names) - sets.lead(part.model.names)
        gain = margin(model, part, fits.likelihood).each
        beyond = gain - np.clip(gain, 0.0, _model_error(part, fits, fits.likelihood))
        return lead > MIN_GAIN and beyond.sum() > (MIN_GAIN if part.model.effects else 0.0)

    for names in (m.names for m in sets.models if m.names):
        model = fits.of(names)
        parts = [m for m in fits.models if m.model.names < names]
        if model is not None and all(leads(model, part) for part in parts):
            yield model


def is_exhausted(fits: Fits) -> bool:
    """Whether effects of the best model leave less on runs left out than one more has to gain.

    Beyond what immaterial amounts of all effects leave there. On the likelihood scale of a model
    that leaves nothing but noise, as most samples show it: a generous floor leaves less than it
    states.
    """
    model = fits.best
    if not model.model.effects:
        return False
    ideal = replace(fits.likelihood, scale=1.0, inefficiency=1.0)
    noise = [0.5 * len(r) * robust.spread(r) ** 2 for r in model.left_out]
    left = model.losses(ideal.scale) - np.array(noise)
    beyond = left - np.clip(left, 0.0, _model_error(model, fits, ideal))
    return bool(beyond.sum() < fits.unresolved + MIN_GAIN)


def _model_error(model: CrossValidatedFit, fits: Fits, likelihood: LikelihoodScale) -> Array:
    """Nats (R,) of each run that errors of the laws of `model` may cost.

    What a law gets wrong of what it explains in a run, another effect would absorb there.
    """
    wrong = np.zeros(len(model.left_out))
    for effect in model.model.effects:
        without = fits.of(model.model.names - {effect.name}) or fits.base
        explained = np.maximum(margin(model, without, likelihood).each, 0.0)
        wrong += effect.model_error**2 * explained
    return wrong


def rivals(accepted: CrossValidatedFit, fits: Fits, sets: Posterior) -> list[CrossValidatedFit]:
    """Models of as many effects as the accepted one that these runs do not exclude.

    Excluded is what is less than ALPHA times as probable, even if the laws of the accepted model
    were without their errors. The most probable comes first.
    """
    least = np.log(ALPHA) - float(_model_error(accepted, fits, fits.likelihood).sum())

    def lead(model: CrossValidatedFit) -> float:
        return sets.lead(model.model.names) - sets.lead(accepted.model.names)

    others = [m for m in fits.of_size(len(accepted.model.names)) if m is not accepted]
    return sorted((m for m in others if lead(m) > least), key=lead, reverse=True)


def classes(accepted: CrossValidatedFit, rivals: Sequence[CrossValidatedFit]) -> list[list[str]]:
    """Classes of effects, by name, that the runs cannot separate from one another.

    Rivals that differ in one effect give the class of the two effects; those that share none
    give one class of all.
    """
    return merged([sorted(accepted.model.names ^ rival.model.names) for rival in rivals])


def merged(groups: Sequence[Sequence[str]]) -> list[list[str]]:
    """Groups of names, those that share a name as one."""
    disjoint: list[set[str]] = []
    for names in groups:
        group = set(names).union(*(g for g in disjoint if not g.isdisjoint(names)))
        disjoint = [*(g for g in disjoint if g.isdisjoint(group)), group]
    return sorted(sorted(g) for g in disjoint)
