"""Shrinks learned biases towards zero: most cells and specimens have none but a camera's error.

Each is the mean over two hypotheses, that something is off and that nothing is, weighted by their
posterior probabilities (Bayesian model averaging; Hoeting et al., 1999, Statistical Science 14).
"""

from collections.abc import Sequence

import numpy as np

from cell.config.learning import LearningSettings
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

    Where nothing is, cell and strip have none, a specimen has a `usual` one, and what the camera
    shows of it holds an error of its own.
    """
    from scipy.special import expit, logit

    y = np.array([e.displacement for e in experiences])
    strips = np.array([e.strip for e in experiences])
    pieces = _specimens(experiences)
    same = (pieces[:, None] == pieces).astype(float)
    noise = settings.repeat**2 * np.eye(len(y))
    right = (settings.usual**2 + settings.misread**2) * same + noise
    wrong = settings.cell**2 + settings.strip**2 * (strips[:, None] == strips)
    wrong = wrong + settings.specimen**2 * same + noise
    usual = settings.usual**2 * (pieces == f"{strip}/{specimen}") @ np.linalg.solve(right, y)
    p = expit(_log_density(y, wrong) - _log_density(y, right) + logit(settings.off))
    cell, fabric, piece = (float(p * part) for part in parts)
    return cell, fabric, piece + float((1.0 - p) * usual)


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
    misread = settings.laid**2 * (pieces[:, None] == pieces)
    misread = misread + settings.repeat**2 * np.eye(len(seen))
    weights = np.linalg.solve(misread, np.ones(len(seen)))
    variance = 1.0 / (weights.sum() + settings.changed**-2)
    mean = variance * float(weights @ seen)
    wrong = misread + settings.changed**2
    p = expit(_log_density(seen, wrong) - _log_density(seen, misread) + logit(settings.off))
    return float(mean * p)


def _specimens(experiences: Sequence[Experience]) -> Array:
    return np.array([f"{e.strip}/{e.specimen}" for e in experiences])


def _log_density(y: Array, covariance: Array) -> float:
    """Log density of y (n,), normal about 0 with `covariance` (n, n), up to a constant."""
    spread = np.linalg.slogdet(covariance)[1]
    return float(-0.5 * (y @ np.linalg.solve(covariance, y) + spread))
