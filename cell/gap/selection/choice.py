"""Choice of the model to accept, and of models that the runs cannot tell from it.

Accepted is the most probable set of effects of which each is needed.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from cell.gap.fitting.crossvalidation import CrossValidatedFit
from cell.gap.selection.likelihood import ALPHA, MIN_GAIN, Fits, LikelihoodScale, gains
from cell.gap.selection.posterior import Posterior
from drivers.base.types import Array


def choose(fits: Fits, sets: Posterior) -> CrossValidatedFit:
    """Most probable model of `fits` in which each effect is needed; the base if none
    is.
    """
    return next(needed_models(fits, sets), fits.base)


def needed_models(fits: Fits, sets: Posterior) -> Iterator[CrossValidatedFit]:
    """Models of `fits` in which each effect is needed, in the order of their
    probability by `sets`.

    A model clearly leads each fitted part of it, the base too, and predicts runs left
    out better: what a fit gains in its own runs, others may not confirm. Beside other
    effects it predicts them clearly better than errors of their laws allow.
    """
    likelihood = fits.likelihood

    def leads(model: CrossValidatedFit, part: CrossValidatedFit) -> bool:
        lead = sets.lead(model.names) - sets.lead(part.names)
        by_run = gains(model, part, likelihood)
        beyond = by_run - np.clip(by_run, 0.0, _model_error(part, fits, likelihood))
        return lead > MIN_GAIN and beyond.sum() > (MIN_GAIN if part.effects else 0.0)

    for names in (m.names for m in sets.models if m.names):
        model = fits.of(names)
        parts = [m for m in fits.models if m.names < names]
        if model and all(leads(model, part) for part in parts):
            yield model


def _model_error(
    model: CrossValidatedFit, fits: Fits, likelihood: LikelihoodScale
) -> Array:
    """Log likelihood (R,) [nats] that each run may lose to errors of the laws in
    `model`.

    What a law gets wrong of what it explains in a run, another effect would absorb
    there.
    """
    wrong = np.zeros(len(model.left_out))
    for effect in model.effects:
        without = fits.of(model.names - {effect.name}) or fits.base
        explained = np.maximum(gains(model, without, likelihood), 0.0)
        wrong += effect.model_error**2 * explained
    return wrong


def rivals(
    accepted: CrossValidatedFit, fits: Fits, sets: Posterior
) -> list[CrossValidatedFit]:
    """Models of as many effects as `accepted` that the runs do not exclude, most
    probable first.

    Excluded is what is less than ALPHA times as probable, even if the laws of the
    accepted model were without their errors, and clearly predicts runs left out worse:
    by MIN_GAIN, and by more than a standard error. Priors alone exclude nothing. What
    stands in for another is no rival.
    """
    least = np.log(ALPHA) - float(_model_error(accepted, fits, fits.likelihood).sum())

    def is_open(model: CrossValidatedFit) -> bool:
        lead = sets.lead(model.names) - sets.lead(accepted.names)
        by_run = gains(accepted, model, fits.likelihood)
        clear = max(MIN_GAIN, np.sqrt(len(by_run)) * by_run.std())
        return lead > least or bool(by_run.sum() < clear)

    others = [m for m in fits.of_size(len(accepted.names)) if not m.proxies]
    return sorted(
        (m for m in others if m is not accepted and is_open(m)),
        key=lambda m: -sets.lead(m.names),
    )


def join_overlapping(groups: Sequence[Sequence[str]]) -> list[list[str]]:
    """Disjoint groups of names, made of `groups` by merging those that share a name."""
    disjoint: list[set[str]] = []
    for names in groups:
        group = set(names).union(*(g for g in disjoint if not g.isdisjoint(names)))
        disjoint = [*(g for g in disjoint if g.isdisjoint(group)), group]
    return sorted(sorted(g) for g in disjoint)
