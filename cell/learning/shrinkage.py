"""Shrinkage of learned biases towards zero: most cells and specimens have no bias of their own.

Each is the mean over two hypotheses, that something is off and that nothing is, weighted by their
posterior probabilities (Bayesian model averaging; Hoeting et al., 1999, Statistical Science 14).
"""

from collections.abc import Sequence

import numpy as np

from cell.config.settings import LearningSettings
from cell.learning.experience import Experience
from drivers.types import Array

Parts = tuple[float, float, float]  # m, of cell, strip and specimen


def shrunk(
    parts: Parts,
    experiences: Sequence[Experience],
    strip: str,
    specimen: str,
    settings: LearningSettings,
) -> Parts:
    """Bias of `specimen`, of fabric `strip`, averaged over both hypotheses about `parts`.

    If nothing is off, cell and strip have no bias, a specimen has a `usual` one, and the camera
    adds an error of its own to each specimen.
    """
    from scipy.special import expit, logit

    y = np.array([e.displacement for e in experiences])
    strips = np.array([e.strip for e in experiences])
    pieces = _specimens(experiences)
    same = (pieces[:, None] == pieces).astype(float)
    noise = settings.repeat**2 * np.eye(len(y))
    # covariances of y: if nothing is off, and if something is
    null = (settings.usual**2 + settings.misread**2) * same + noise
    off = settings.cell**2 + settings.strip**2 * (strips[:, None] == strips)
    off = off + settings.specimen**2 * same + noise
    usual = settings.usual**2 * (pieces == f"{strip}/{specimen}") @ np.linalg.solve(null, y)
    p_off = expit(_log_density(y, off) - _log_density(y, null) + logit(settings.off))
    of_cell, of_strip, of_specimen = (float(p_off * part) for part in parts)
    return of_cell, of_strip, of_specimen + float((1.0 - p_off) * usual)


def laid_offset(experiences: Sequence[Experience], rig: float, settings: LearningSettings) -> float:
    """Offset [m] of laid edges in a cell whose camera shows them `rig` [m] too small.

    Either something is `off`, by about `changed`, or nothing is and the camera misreads each
    specimen by about `laid`.
    """
    known = [e for e in experiences if e.edges is not None and abs(e.edges) < settings.limit]
    if not known:
        return 0.0
    from scipy.special import expit, logit

    seen = np.array([e.edges for e in known], dtype=float) + rig
    pieces = _specimens(known)
    # covariances of the seen offsets: if nothing is off, and if something is
    null = settings.laid**2 * (pieces[:, None] == pieces)
    null = null + settings.repeat**2 * np.eye(len(seen))
    off = null + settings.changed**2
    weights = np.linalg.solve(null, np.ones(len(seen)))
    variance = 1.0 / (weights.sum() + settings.changed**-2)
    mean = variance * float(weights @ seen)
    p_off = expit(_log_density(seen, off) - _log_density(seen, null) + logit(settings.off))
    return float(mean * p_off)


def _specimens(experiences: Sequence[Experience]) -> Array:
    return np.array([f"{e.strip}/{e.specimen}" for e in experiences])


def _log_density(y: Array, covariance: Array) -> float:
    """Log density of y (n,), normal about 0 with `covariance` (n, n), up to a constant."""
    spread = np.linalg.slogdet(covariance)[1]
    return float(-0.5 * (y @ np.linalg.solve(covariance, y) + spread))
