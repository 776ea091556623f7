"""Robust likelihood of residuals: Huber's loss, their dispersion and
autocorrelation.
"""

from collections.abc import Sequence

import numpy as np
from scipy import special

from cell.gap.subject.subject import FitRun
from drivers.base.geometry import robust_sigma
from drivers.base.types import Array

# in units of the scale, where Huber's loss turns from square to linear; set by hand,
# for normal residuals are beyond it once in 370
HUBER_THRESHOLD = 3.0
# in units of the scale: beyond it a sample shows that the strip went another way, not
# how far
OFF_TRACK = 5.0  # set by hand


def loss(r: Array) -> Array:
    """Huber's loss (n,) [nats] of whitened residuals (n,) (Huber 1964, Ann. Math. Stat.
    35, 73).
    """
    nats: Array = special.huber(HUBER_THRESHOLD, r)
    return nats


def bounded_loss(r: Array) -> Array:
    """Huber's loss (n,) [nats] of whitened residuals `r` (n,), constant beyond
    OFF_TRACK.

    In comparisons no single sample may decide (Hampel et al. 1986, redescending
    estimators).
    """
    return loss(bound(r))


def bound(r: Array, scale: float = 1.0) -> Array:
    """Residuals (n,) clipped at OFF_TRACK times `scale`, so that outliers weigh no
    more.
    """
    return np.clip(r, -OFF_TRACK * scale, OFF_TRACK * scale)


def weights(r: Array) -> Array:
    """Huber's weights psi(r) / r (n,) of residuals `r` (n,), for reweighted least
    squares.
    """
    return np.minimum(1.0, HUBER_THRESHOLD / np.maximum(np.abs(r), 1e-300))


def clip_residuals(r: Array) -> Array:
    """Whitened residuals (n,) clipped at Huber's threshold: their influence psi(r) on a
    fit.
    """
    return np.clip(r, -HUBER_THRESHOLD, HUBER_THRESHOLD)


def scale(r: Array) -> float:
    """Robust standard deviation of whitened residuals (n,), at least 1."""
    return max(1.0, robust_sigma(r)) if len(r) else 1.0


def inefficiency(runs: Sequence[FitRun], residuals: Sequence[Array]) -> float:
    """Statistical inefficiency: number of correlated samples per independent one, at
    least 1.

    1 + 2 times the sum of autocorrelations, pooled over all series of all runs,
    residuals (n,) each, summed by pairs of lags while they stay positive (Geyer 1992,
    Practical Markov chain Monte Carlo, initial positive sequence). Residuals that are
    smaller than their scale, as a generous floor leaves them, count by their long-run
    variance.
    """
    return max(1.0, long_run_variance(runs, residuals))


def long_run_variance(runs: Sequence[FitRun], residuals: Sequence[Array]) -> float:
    """Long-run variance of residuals (n,) in units of their scale squared: the variance
    of their sum over n.
    """
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

    stated_power = sum(len(r) * s * s for r in residuals)
    return float(total * min(1.0, power / stated_power))


def correlation(runs: Sequence[FitRun], residuals: Sequence[Array]) -> float:
    """Lag-one autocorrelation of the residuals (n,) of `runs`, each clipped at
    OFF_TRACK.
    """
    power, products = _autocovariance(runs, [*map(bound, residuals)], lags=1)
    return float(products[0]) / power if power > 0.0 else 0.0


def _autocovariance(
    runs: Sequence[FitRun], residuals: Sequence[Array], lags: int = 40
) -> tuple[float, Array]:
    """Sums of squares, and of products at each lag (lags,), of the residuals of all
    series of all runs.
    """
    power = 0.0
    products = np.zeros(lags)
    for run, r in zip(runs, residuals, strict=True):
        owner = run.samples.series
        for series in np.unique(owner):
            x = r[owner == series]
            power += x @ x
            for k in range(1, min(lags, len(x) - 1) + 1):
                products[k - 1] += x[:-k] @ x[k:]
    return power, products
