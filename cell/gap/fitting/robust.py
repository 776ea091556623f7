"""Robust likelihood: Huber's loss, its scale, and how independent samples really are."""

from collections.abc import Sequence

import numpy as np

from cell.gap.subject.subject import Run
from drivers.types import Array

# in units of the scale, where Huber's loss turns from square to linear; set by hand, for normal
# residuals are beyond it once in 370
HUBER_THRESHOLD = 3.0
# beyond which a sample says that the strip went another way, not how far; set by hand
OFF_TRACK = 5.0


def loss(r: Array) -> Array:
    """Huber's rho (Huber 1964, Robust estimation of a location parameter): nats per sample."""
    a = np.abs(r)
    return np.where(
        a <= HUBER_THRESHOLD, 0.5 * r * r, HUBER_THRESHOLD * (a - 0.5 * HUBER_THRESHOLD)
    )


def bounded_loss(r: Array) -> Array:
    """Huber's loss up to OFF_TRACK, no more beyond: for judging fits, where no single sample that
    went another way may decide (Hampel et al. 1986, redescending estimators).
    """
    return loss(np.clip(r, -OFF_TRACK, OFF_TRACK))


def weights(r: Array) -> Array:
    """psi(r) / r (n,) of Huber's loss: the weights of iterated least squares."""
    return np.minimum(1.0, HUBER_THRESHOLD / np.maximum(np.abs(r), 1e-300))


def clip_residuals(r: Array) -> Array:
    """psi(r) (n,) of Huber's loss: what a residual weighs in the fit."""
    return np.clip(r, -HUBER_THRESHOLD, HUBER_THRESHOLD)


def scale(r: Array) -> float:
    """Dispersion of residuals (n,) in units of the stated noise, at least 1."""
    return max(1.0, _deviation(r)) if len(r) else 1.0


def spread(r: Array) -> float:
    """Dispersion of residuals (n,) in units of noise and floor, at most 1."""
    return min(1.0, _deviation(r)) if len(r) else 1.0


def _deviation(r: Array) -> float:
    """Normalised median absolute residual."""
    return 1.4826 * float(np.median(np.abs(r)))


def inefficiency(runs: Sequence[Run], residuals: Sequence[Array]) -> float:
    """Samples worth one independent sample: 1 + 2 times the sum of autocorrelations.

    Pooled over all series of all runs, residuals (n,) each, summed by pairs of lags while they
    stay positive (Geyer 1992, Practical Markov chain Monte Carlo, initial positive sequence).
    Residuals that are smaller than their scale, as a generous floor leaves them, count by their
    long-run variance.
    """
    return max(1.0, long_run_variance(runs, residuals))


def long_run_variance(runs: Sequence[Run], residuals: Sequence[Array]) -> float:
    """Variance of sums of residuals (n,) over their number, in units of their scale squared."""
    s = scale(np.concatenate(residuals)) if residuals else 1.0
    clipped = [np.clip(r, -HUBER_THRESHOLD * s, HUBER_THRESHOLD * s) for r in residuals]
    power, products = _autocovariance(runs, clipped)
    if power <= 0.0:
        return 1.0
    rho = products / power
    total = 1.0
    for k in range(0, len(rho) - 1, 2):
        pair = rho[k] + rho[k + 1]
        if pair <= 0.0:
            break
        total += 2.0 * pair
    room = sum(len(r) * s * s for r in residuals)
    return float(total * min(1.0, power / room))


def correlation(runs: Sequence[Run], residuals: Sequence[Array]) -> float:
    """Correlation of neighbours in time among residuals (n,) of runs, wild ones bounded."""
    power, products = _autocovariance(
        runs, [np.clip(r, -OFF_TRACK, OFF_TRACK) for r in residuals], lags=1
    )
    return float(products[0]) / power if power > 0.0 else 0.0


def _autocovariance(
    runs: Sequence[Run], residuals: Sequence[Array], lags: int = 40
) -> tuple[float, Array]:
    power, products = 0.0, np.zeros(lags)
    for run, r in zip(runs, residuals, strict=True):
        for series in np.unique(run.samples.series):
            x = r[run.samples.series == series]
            power += float(x @ x)
            for k in range(1, min(lags, len(x) - 1) + 1):
                products[k - 1] += float(x[:-k] @ x[k:])
    return power, products
