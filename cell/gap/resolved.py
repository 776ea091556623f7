"""Whether a fitted effect differs from nothing."""

import numpy as np

from cell.gap import quadratic
from cell.gap.compare import Yardstick
from cell.gap.refit import Estimate
from cell.gap.subject import Candidate

WIDTH = 1.96  # standard deviations of a 95 % interval
BLIND = 0.9  # of what was known before: a fit that says less says nothing


def resolved(estimate: Estimate, effect: Candidate, by: Yardstick) -> bool:
    """Whether the interval of any of its amounts excludes absence (Wald 1943).

    True where the fit says nothing of them: beyond its threshold an effect may no longer depend
    on how strong it is.
    """
    spread = np.sqrt(np.diag(quadratic.covariance(estimate.normal())) * by.inefficiency)
    first = len(estimate.model.base)
    for other in estimate.model.effects:
        if other.name == effect.name:
            break
        first += len(other.parameters)
    for i, p in enumerate(effect.parameters, start=first):
        far = abs(estimate.shared[i] - p.start) > WIDTH * spread[i]
        if not p.shape and (far or spread[i] > BLIND * p.spread):
            return True
    return False
