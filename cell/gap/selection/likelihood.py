"""Comparison of models by predictive likelihood: margins [nats] and their p-values."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from cell.gap.fitting import robust
from cell.gap.fitting.crossvalidation import CrossValidatedFit
from drivers.types import Array

MIN_GAIN = 4.0  # nats, 55 times as likely: "strong" (Kass and Raftery 1995, J. Am. Stat. Assoc. 90)
ALPHA = 0.01  # probability of a false alarm, family-wise; customary


@dataclass(frozen=True, slots=True)
class LikelihoodScale:
    """Scale of log-likelihoods: the dispersion and statistical inefficiency of the best model.

    Where even the best model leaves more than noise, or leaves it correlated, log-likelihoods
    shrink by as much (quasi-likelihood: McCullagh and Nelder 1989, chapter 9).
    """

    scale: float
    inefficiency: float

    def standardise(self, distance: float) -> float:
        """Distance [sigma] of two models from their whitened `distance`."""
        return distance / self.scale / math.sqrt(self.inefficiency)


def likelihood_scale(models: Sequence[CrossValidatedFit]) -> LikelihoodScale:
    """Scale of log-likelihoods from the model of `models` that fits best."""
    best = min(models, key=lambda m: (m.estimate.scale, m.estimate.objective))
    scale = best.estimate.scale
    inefficiency = robust.inefficiency(best.estimate.evidence.runs, best.estimate.residuals)
    return LikelihoodScale(scale, inefficiency)


@dataclass(frozen=True, slots=True)
class Margin:
    """How much better one model predicts than another: `each` (R,) [nats] in a run left out."""

    each: Array

    @property
    def gain(self) -> float:
        """Sum over runs [nats]."""
        return float(self.each.sum())

    @property
    def se(self) -> float:
        """Standard error of the sum over runs [nats]; 0 of one run."""
        n = len(self.each)
        return float(np.sqrt(n) * self.each.std(ddof=1)) if n > 1 else 0.0


def margin(
    model: CrossValidatedFit, other: CrossValidatedFit, likelihood: LikelihoodScale
) -> Margin:
    """Margin of `model` over `other`, nested or not."""
    ahead = other.losses(likelihood.scale) - model.losses(likelihood.scale)
    return Margin(ahead / likelihood.inefficiency)


def likelihood_ratio_p(
    model: CrossValidatedFit, part: CrossValidatedFit, likelihood: LikelihoodScale
) -> float:
    """p-value of the likelihood-ratio test of `model` against `part`, nested in it (Wilks 1938).

    It is conservative where the sign of a parameter is fixed.
    """
    loss = sum(float(robust.loss(r / likelihood.scale).sum()) for r in model.estimate.residuals)
    nested = sum(float(robust.loss(r / likelihood.scale).sum()) for r in part.estimate.residuals)
    freedom = len(model.model.parameters) - len(part.model.parameters)
    return float(special.chdtrc(freedom, max(0.0, 2.0 * (nested - loss) / likelihood.inefficiency)))


def family_wise(p: Mapping[str, float], names: Sequence[str]) -> dict[str, float]:
    """Family-wise p-values of all `names`; a name without a test counts as p = 1."""
    return dict(zip(names, holm([p.get(name, 1.0) for name in names]), strict=True))


def holm(p: Sequence[float]) -> list[float]:
    """Family-wise p-values (Holm 1979), in the order of `p`."""
    order = np.argsort(p)
    adjusted = np.empty(len(p))
    running = 0.0
    for rank, i in enumerate(order):
        running = max(running, (len(p) - rank) * p[i])
        adjusted[i] = min(1.0, running)
    return [float(v) for v in adjusted]
