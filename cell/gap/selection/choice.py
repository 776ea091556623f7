"""Choice of the accepted model, and the models that these runs cannot distinguish from it.

Accepted is the most probable set of effects of which each is needed.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from cell.gap.fitting.crossvalidation import CrossValidatedFit
from cell.gap.selection.likelihood import ALPHA, MIN_GAIN, Fits, LikelihoodScale, margin
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
    likelihood = fits.likelihood

    def leads(model: CrossValidatedFit, part: CrossValidatedFit) -> bool:
        lead = sets.lead(model.model.names) - sets.lead(part.model.names)
        gain = margin(model, part, likelihood).each
        beyond = gain - np.clip(gain, 0.0, _model_error(part, fits, likelihood))
        return lead > MIN_GAIN and beyond.sum() > (MIN_GAIN if part.model.effects else 0.0)

    for names in (m.names for m in sets.models if m.names):
        model = fits.of(names)
        parts = [m for m in fits.models if m.model.names < names]
        if model is not None and all(leads(model, part) for part in parts):
            yield model


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
