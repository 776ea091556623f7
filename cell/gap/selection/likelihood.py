"""Fitted models of the same runs, compared by their predictive likelihoods."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from scipy import special

from cell.gap.fitting import robust
from cell.gap.fitting.crossvalidation import CrossValidatedFit
from cell.gap.fitting.gauss_newton import FitEstimate, best
from drivers.base.types import Array

# nats, 55 times as likely: "strong" (Kass and Raftery 1995, J. Am. Stat. Assoc. 90)
MIN_GAIN = 4.0
# of the best model's gain, below which a model is left out; set by hand
GAIN_SHARE = 0.5
ALPHA = 0.01  # probability of a false alarm, family-wise; customary


class LikelihoodScale(NamedTuple):
    """Dispersion and statistical inefficiency of residuals, by which all
    log-likelihoods of models are divided.

    Where even the best model leaves more than noise, or leaves it correlated,
    log-likelihoods shrink by as much (quasi-likelihood: McCullagh and Nelder 1989,
    chapter 9).
    """

    scale: float
    inefficiency: float


def best_fitting(models: Sequence[CrossValidatedFit]) -> FitEstimate:
    """Fit of that one of `models` whose residuals have the smallest dispersion or,
    among equals, the smallest objective.
    """
    return min(models, key=lambda fit: (fit.scale, fit.objective))


def likelihood_scale(models: Sequence[CrossValidatedFit]) -> LikelihoodScale:
    """Dispersion and inefficiency of the residuals of that one of `models` that fits
    best.
    """
    fit = best_fitting(models)
    return LikelihoodScale(fit.scale, robust.inefficiency(fit.runs, fit.residuals))


def gains(
    model: CrossValidatedFit, other: CrossValidatedFit, likelihood: LikelihoodScale
) -> Array:
    """Log predictive likelihood ratio (runs,) [nats] of `model` to `other` for each
    run; the models need not be nested.
    """
    ahead = other.losses(likelihood.scale) - model.losses(likelihood.scale)
    return ahead / likelihood.inefficiency


def gain(
    model: CrossValidatedFit, other: CrossValidatedFit, likelihood: LikelihoodScale
) -> float:
    """Log predictive likelihood ratio [nats] of `model` to `other` over all runs."""
    return float(gains(model, other, likelihood).sum())


@dataclass(frozen=True, slots=True)
class Fits:
    """Fitted models of the same runs, one for each set of effects, the empty set
    included.

    `library` has for each effect the whitened response (N, k) to the amount that fills
    its floor.
    """

    models: Sequence[CrossValidatedFit]
    library: Mapping[str, Array] = field(default_factory=dict)

    @property
    def base(self) -> CrossValidatedFit:
        """Fitted model without any effect."""
        return next(model for model in self.models if not model.effects)

    @property
    def likelihood(self) -> LikelihoodScale:
        """Likelihood scale of these fits: dispersion and inefficiency of the best
        fitting one.
        """
        return likelihood_scale(self.models)

    def of_size(self, size: int) -> list[CrossValidatedFit]:
        """Fitted models with `size` effects, the one that predicts best first."""
        return _by_loss(
            [model for model in self.models if len(model.effects) == size],
            self.likelihood,
        )

    def of(self, names: frozenset[str]) -> CrossValidatedFit | None:
        """Fitted model with exactly the effects `names`; None where there is no such
        model.
        """
        return next((model for model in self.models if model.names == names), None)

    @property
    def best(self) -> CrossValidatedFit:
        """Fitted model that predicts left-out runs best, whatever its number of
        effects.
        """
        return _by_loss(self.models, self.likelihood)[0]

    def near_best(self, size: int) -> list[CrossValidatedFit]:
        """Fitted models with `size` effects that reach more than GAIN_SHARE of the best
        one's gain.
        """
        if not size:
            return []
        nats = [
            (model, gain(model, self.base, self.likelihood))
            for model in self.of_size(size)
        ]
        most = max((n for _, n in nats), default=0.0)
        return [m for m, n in nats if n > GAIN_SHARE * most]

    def merge(self, more: Sequence[CrossValidatedFit]) -> "Fits":
        """Copy of the fits with the models `more` added; of two models with equal
        effects the better fit is kept.
        """
        merged = {model.names: model for model in self.models}
        for model in more:
            earlier = merged.get(model.names)
            if not earlier or best([earlier, model]) is model:
                merged[model.names] = model
        return replace(self, models=[*merged.values()])


def _by_loss(
    models: Sequence[CrossValidatedFit], likelihood: LikelihoodScale
) -> list[CrossValidatedFit]:
    """`models` sorted by predictive loss at the scale `likelihood`, the best first."""
    return sorted(models, key=lambda m: (m.losses(likelihood.scale).sum(), m.name))


def likelihood_ratio_p(
    model: CrossValidatedFit, part: CrossValidatedFit, likelihood: LikelihoodScale
) -> float:
    """p-value of the likelihood-ratio test of `model` against `part`, nested in it
    (Wilks 1938).

    It is conservative where the sign of a parameter is fixed.
    """
    scale = likelihood.scale
    loss = robust.loss(model.stacked_residuals / scale).sum()
    nested = robust.loss(part.stacked_residuals / scale).sum()
    ratio = 2.0 * (nested - loss) / likelihood.inefficiency
    freedom = len(model.shared) - len(part.shared)
    return float(special.chdtrc(freedom, max(0.0, ratio)))


def holm(p: Mapping[str, float]) -> dict[str, float]:
    """Family-wise p-values by name, from single ones `p`, by Holm's step-down method
    (1979).
    """
    order = sorted(p, key=lambda name: p[name])
    steps = np.arange(len(p), 0, -1) * np.array([p[name] for name in order])
    adjusted = np.minimum(1.0, np.maximum.accumulate(steps))
    return dict(zip(order, map(float, adjusted), strict=True))
