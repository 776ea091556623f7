"""Correction of a critic that was trained in simulation, learned from folds through
images.

The critic's displacement has a bias, predicted minus true, in folds unlike its
training.
"""

import math
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from drivers.base.settings import Settings, StudyResult
from drivers.base.types import Array
from policies.adaptive.critic import Belief

# ln of m, bending length at which its term is zero
REFERENCE_LOG_LENGTH = math.log(0.02)
REFERENCE_THICKNESS = 1e-3  # m, thickness at which its term is zero
Coefficient = Annotated[float, Field(gt=-100.0, lt=100.0)]  # as any plausible one is


class Untrained(StudyResult):
    """Extra standard deviation `added` [m] of the critic for effects outside its
    training.

    Examples: another engine, lost images. `python -m tests.lab study unknown` fits it
    to `folds`; of these the shares `within_1` and `within_2` then err by less than 1
    and 1.96 sigma.
    """

    FILE = Path(__file__).with_name("untrained.yaml")
    added: float
    within_1: float
    within_2: float
    folds: int


class CriticBias(Settings):
    """Bias [m] of the critic's displacement, linear in ln bending length and thickness.

    Constant `always` [m], `of_length` [m] per unit of ln bending length, `of_thickness`
    per m of thickness beyond 1 mm. The critic's sigmas are right after multiplication
    by `sigma`; an unmeasured thickness adds `unmeasured` [m], effects outside the
    training add `untrained` [m]. The default corrects nothing, as for folds like those
    of the training.
    """

    always: Coefficient = 0.0
    of_length: Coefficient = 0.0
    of_thickness: Coefficient = 0.0
    sigma: Coefficient = 1.0
    unmeasured: Coefficient = 0.0
    untrained: Coefficient = 0.0

    def estimate(self, belief: Belief, thickness: float | None) -> Array:
        """Bias (n,) [m] for n strips estimated as `belief`; `thickness` [m] is None if
        unknown.
        """
        beyond = np.array(0.0 if thickness is None else thickness - REFERENCE_THICKNESS)
        terms = bias_terms(belief.log_bending_length[:, 0], beyond)
        return np.asarray(
            terms @ np.array([self.always, self.of_length, self.of_thickness])
        )

    def sigma_of(self, sigma: Array, thickness: float | None) -> Array:
        """Corrected standard deviations (n,) [m] of displacements, from the critic's
        `sigma`.
        """
        added = np.hypot(self.untrained, self.unmeasured if thickness is None else 0.0)
        return np.hypot(self.sigma * sigma, added)


def bias_terms(log_length: Array, beyond: Array) -> Array:
    """Regressors (n, 3) of the bias from ln bending length (n,), thickness beyond 1 mm
    (n,) [m].
    """
    length, beyond = np.broadcast_arrays(log_length - REFERENCE_LOG_LENGTH, beyond)
    return np.stack([np.ones_like(length), length, beyond], axis=1)
