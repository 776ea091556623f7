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

LAW_ERROR = 0.02  # of a lead in nats: square of 15 %, by which responses are wrong; set by hand
EXPLAINED = 0.5  # of what an effect gains, that may be missing in its rival; set by hand
PRESENT = 0.5  # inclusion probability from which an effect is rather there than not


@dataclass(frozen=True, slots=True)
class Choice:
    """The accepted model (the base where none is), all fits, and the scale of their comparison."""

    accepted: CrossValidatedFit
    fits: Fits
    by: LikelihoodScale


def choose(fits: Fits, sets: Posterior) -> Choice:
    """Accept the most probable model of which each effect is needed; else the base."""
    return Choice(next(needed_models(fits, sets), fits.base), fits, fits.scale)


def needed_models(fits: Fits, sets: Posterior) -> Iterator[CrossValidatedFit]:
    """Models of which each effect is needed, the most probable first.

    A model clearly leads each fitted part of it, the base too, and predicts runs left out better:
    what a fit gains in its own runs, others may not confirm.
    """
    scale = fits.scale.scale

    def leads(model: CrossValidatedFit, part: CrossValidatedFit) -> bool:
        lead = sets.lead(model.model.names) - sets.lead(part.model.names)
        return lead > MIN_GAIN and bool(model.losses(scale).sum() < part.losses(scale).sum())

    for names in (m.names for m in sets.models if m.names):
        model = fits.of(names)
        parts = [m for m in fits.models if m.model.names < names]
        if model is not None and all(leads(model, part) for part in parts):
            yield model


def is_exhausted(fits: Fits) -> bool:
    """Whether the effects of the best model leave too little for a further one to explain."""
    return leaves_nothing(fits.best, fits)


def leaves_nothing(model: CrossValidatedFit, fits: Fits) -> bool:
    """Whether effects of `model` leave less on runs left out than a further one has to gain.

    Beyond what immaterial amounts of all effects leave there. On the likelihood scale of a model
    that leaves nothing but noise, as most samples show it: a generous floor leaves less than it
    states.
    """
    if not model.model.effects:
        return False
    ideal = replace(fits.scale, scale=1.0, inefficiency=1.0)
    noise = [0.5 * len(r) * robust.spread(r) ** 2 for r in model.left_out]
    left = model.losses(ideal.scale) - np.array(noise)
    return _beyond_model_error(left, model, fits, ideal) < fits.unresolved + MIN_GAIN


def _beyond_model_error(
    left: Array, model: CrossValidatedFit, fits: Fits, by: LikelihoodScale
) -> float:
    """Sum of what is `left` (R,) [nats] in each run, less what errors of its laws may explain.

    What a law gets wrong of what it explains in a run, another effect would absorb there.
    """
    explained = np.maximum(margin(model, fits.base, by).each, 0.0)
    wrong = max(e.model_error for e in model.model.effects) * explained
    return float(np.sum(left - np.clip(left, 0.0, wrong)))


@dataclass(frozen=True, slots=True)
class Alternative:
    """A rival of the accepted model, and the nats by which it is `behind`."""

    model: CrossValidatedFit
    behind: float


def rivals(accepted: CrossValidatedFit, fits: Fits, sets: Posterior) -> list[Alternative]:
    """Models that explain the runs about as well as the accepted one, and more probable ones."""
    return [*probable_rivals(accepted, fits, sets), *more_probable(accepted, fits, sets)]


def probable_rivals(accepted: CrossValidatedFit, fits: Fits, sets: Posterior) -> list[Alternative]:
    """Models of as many effects as the accepted one that the posterior does not exclude.

    Excluded is what is less than ALPHA times as probable, beyond what errors of laws may decide.
    """
    others = [_alternative(accepted, m, sets) for m in fits.of_size(len(accepted.model.effects))]
    found = [
        r
        for r in others
        if r.model is not accepted and r.behind < -np.log(ALPHA) + _law_error(accepted, r, sets)
    ]
    return sorted(found, key=lambda r: r.behind)


def _law_error(accepted: CrossValidatedFit, rival: Alternative, sets: Posterior) -> float:
    """Nats by which a rival may be behind `accepted` though it is true, since no law is exact.

    The share LAW_ERROR of what the accepted set gains over the base, but at most the share
    EXPLAINED of what is gained by the effects that the rival lacks: what the rival has in their
    place must gain the rest.
    """
    names = accepted.model.names
    lead, shared = sets.lead(names), names & rival.model.model.names
    fitted = {m.names for m in sets.models}
    gain = lead - sets.lead(shared) if shared in fitted else lead
    return max(0.0, min(LAW_ERROR * lead, EXPLAINED * gain))


def _alternative(
    accepted: CrossValidatedFit, other: CrossValidatedFit, sets: Posterior
) -> Alternative:
    return Alternative(other, sets.lead(accepted.model.names) - sets.lead(other.model.names))


def more_probable(accepted: CrossValidatedFit, fits: Fits, sets: Posterior) -> list[Alternative]:
    """For each improbable accepted effect, the most probable fitted model without it.

    The model of no effect does not count: whether there is a gap at all is decided elsewhere.
    """
    found = []
    doubted = (e for e in accepted.model.names if sets.inclusion[e] < PRESENT)
    for effect in sorted(doubted):
        names = next(m.names for m in sets.models if effect not in m.names)
        other = fits.of(names)
        if names and other is not None:
            found.append(_alternative(accepted, other, sets))
    return found


def classes(accepted: CrossValidatedFit, found: Sequence[Alternative]) -> list[list[str]]:
    """Classes of effects, by name, that the runs cannot separate from one another.

    Rivals that differ in one effect give the class of the two effects; those that share none
    give one class of all.
    """
    mine = accepted.model.names
    merged: list[set[str]] = []
    for rival in found:
        group = set(mine ^ rival.model.model.names)
        touching = [g for g in merged if g & group]
        for g in touching:
            group |= g
            merged.remove(g)
        merged.append(group)
    return sorted(sorted(g) for g in merged)
