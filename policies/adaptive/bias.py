"""Displacement that the critic foresees minus the one that comes, where folds differ from those of
its training.
"""

from dataclasses import dataclass

import numpy as np

from drivers.types import Array
from policies.adaptive.critic import Belief

ROUGHEST = 2.0  # of ln(1 + yield curvature / ROUGH), beyond which nothing was measured
LENGTH = np.log(0.02)  # ln of m, about which the fit is made
THICKNESS = 1e-3  # m, likewise


@dataclass(frozen=True, slots=True)
class Bias:
    """Bias [m]: `always`, `of_length`, `of_friction` and `of_both`, the product of these, by the
    logarithms that a belief holds, and `of_thickness` per m beyond 1 mm.

    Afterwards the critic's sigmas are right but for the factor `sigma`, which grows by `rough` with
    friction; a thickness that nobody measured adds `unmeasured` [m].
    """

    always: float = 0.0
    of_length: float = 0.0
    of_friction: float = 0.0
    of_both: float = 0.0
    of_thickness: float = 0.0
    sigma: float = 1.0
    rough: float = 0.0
    unmeasured: float = 0.0

    def of(self, belief: Belief, thickness: float | None) -> Array:
        """Bias (n,) [m] for n folds of this `belief`; `thickness` [m] is None where not known."""
        length = belief.log_bending_length[:, 0] - LENGTH
        friction = _friction(belief)
        bias = self.always + self.of_length * length
        bias = bias + (self.of_friction + self.of_both * length) * friction
        beyond = 0.0 if thickness is None else thickness - THICKNESS
        return np.asarray(bias + self.of_thickness * beyond)

    def sigma_of(self, sigma: Array, belief: Belief, thickness: float | None) -> Array:
        """Sigma (n,) [m] of what is left, where the critic tells `sigma` (n,) [m]."""
        own = (self.sigma + self.rough * _friction(belief)) * sigma
        return np.hypot(own, self.unmeasured if thickness is None else 0.0)


def _friction(belief: Belief) -> Array:
    return np.clip(belief.friction[:, 0], 0.0, ROUGHEST)


IN_ROD = Bias()
"""Of folds like those of the training."""
THROUGH_IMAGES = Bias(
    *(1.22e-3, -1.38e-3, -0.35e-3, -1.18e-3, 0.48), sigma=0.75, rough=0.3, unmeasured=0.9e-3
)
"""Of folds of the chain through images: least squares over 70 folds, 0.5 mm rms of smooth strips,
0.9 of rough ones (`python -m tests.benchmarks.measure_foretold`, `python -m
tests.benchmarks.measure_unknown --calipers`). To the critic, the tenths of a millimetre by which
images are off are damping, the more the softer the strip.
"""
