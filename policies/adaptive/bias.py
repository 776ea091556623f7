"""Displacement that the critic foresees minus the one that comes, where folds differ from those of
its training.
"""

from dataclasses import dataclass

import numpy as np

from drivers.types import Array
from policies.adaptive.critic import Belief

LENGTH = np.log(0.02)  # ln of m, about which the fit is made
THICKNESS = 1e-3  # m, likewise


@dataclass(frozen=True, slots=True)
class Bias:
    """Bias [m]: `always`, `of_length` by the logarithm that a belief holds, and `of_thickness` per
    m beyond 1 mm.

    Afterwards the critic's sigmas are right but for the factor `sigma`; a thickness that nobody
    measured adds `unmeasured` [m].
    """

    always: float = 0.0
    of_length: float = 0.0
    of_thickness: float = 0.0
    sigma: float = 1.0
    unmeasured: float = 0.0

    def of(self, belief: Belief, thickness: float | None) -> Array:
        """Bias (n,) [m] for n folds of this `belief`; `thickness` [m] is None where not known."""
        length = belief.log_bending_length[:, 0] - LENGTH
        beyond = 0.0 if thickness is None else thickness - THICKNESS
        return np.asarray(self.always + self.of_length * length + self.of_thickness * beyond)

    def sigma_of(self, sigma: Array, thickness: float | None) -> Array:
        """Sigma (n,) [m] of what is left, where the critic tells `sigma` (n,) [m]."""
        return np.hypot(self.sigma * sigma, self.unmeasured if thickness is None else 0.0)


IN_ROD = Bias()
"""Of folds like those of the training."""
THROUGH_IMAGES = Bias(0.66e-3, -1.05e-3, 0.47, sigma=1.0, unmeasured=0.6e-3)
"""Of folds of the chain through images: least squares over 46 folds of smooth and rough strips,
0.5 mm rms (`python -m tests.benchmarks.measure_unknown --calipers`).
"""
