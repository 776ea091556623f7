"""All fitted models of the same runs: the base, and every model with effects beside it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from cell.gap.fitting.crossvalidation import CrossValidatedFit
from cell.gap.fitting.gauss_newton import best
from cell.gap.fitting.projection import projection
from cell.gap.selection.likelihood import LikelihoodScale, likelihood_scale, margin
from cell.gap.selection.prior import immaterial
from drivers.types import Array

GAIN_SHARE = 0.5  # of the best model's gain, below which a model is left out; set by hand


@dataclass(frozen=True, slots=True)
class Fits:
    """Fitted models of the same runs, each set of effects once; one of them is the base.

    `library` has the whitened response (N, k) to the amount of each effect that fills the floor.
    """

    models: tuple[CrossValidatedFit, ...]
    library: Mapping[str, Array] = field(default_factory=dict)

    @property
    def base(self) -> CrossValidatedFit:
        """The model without effects."""
        return next(m for m in self.models if not m.model.effects)

    @property
    def likelihood(self) -> LikelihoodScale:
        """Scale of log-likelihoods, from the model that fits best."""
        return likelihood_scale(self.models)

    @property
    def immaterial(self) -> list[Array]:
        """Whitened responses (N, k) to one sigma of each effect's spike prior."""
        return immaterial(self.library)

    @property
    def unresolved(self) -> float:
        """Mean [nats] of what the spike prior leaves once the base absorbs what it can."""
        left = projection(self.base.estimate, robustly=False).left
        return 0.5 * sum(float(np.sum(response * left(response))) for response in self.immaterial)

    def of_size(self, size: int) -> list[CrossValidatedFit]:
        """Models of `size` effects, the one that predicts best first."""
        return by_loss([m for m in self.models if len(m.model.effects) == size], self.likelihood)

    def of(self, names: frozenset[str]) -> CrossValidatedFit | None:
        """The model with exactly these effects, if it was fitted."""
        return next((m for m in self.models if m.model.names == names), None)

    @property
    def best(self) -> CrossValidatedFit:
        """The model that predicts best, whatever its size."""
        return by_loss(self.models, self.likelihood)[0]

    def near_best(self, size: int, share: float = GAIN_SHARE) -> list[CrossValidatedFit]:
        """Models of `size` effects that gain over the `share` of what the best of them gains."""
        if not size:
            return []
        models = self.of_size(size)
        gains = [margin(m, self.base, self.likelihood).gain for m in models]
        return [m for m, gain in zip(models, gains, strict=True) if gain > share * gains[0]]

    def merge(self, more: Sequence[CrossValidatedFit]) -> "Fits":
        """Fits with `more` added; of two fits of the same effects the better one is kept."""
        found = {m.model.names: m for m in self.models}
        for m in more:
            known = found.get(m.model.names)
            if known is None or best([known.estimate, m.estimate]) is m.estimate:
                found[m.model.names] = m
        return replace(self, models=tuple(found.values()))


def by_loss(
    models: Sequence[CrossValidatedFit], likelihood: LikelihoodScale
) -> list[CrossValidatedFit]:
    """Sort `models` by their predictive loss, the best first."""
    return sorted(models, key=lambda m: (float(m.losses(likelihood.scale).sum()), m.model.name))
