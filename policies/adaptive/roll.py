"""How far the loop rolls on after the touch, and how much of it the fold makes up for."""

import numpy as np

from drivers.types import Array
from policies.adaptive.critic import Belief

# Of the final offset of the edges minus d [m], by `terms`: robust least squares over folds of the
# chain, 62 from states and 46 through images, half of them with yarn friction, 0.8 mm rms through
# images (`measure_roll` and `measure_unknown` in `tests.benchmarks`).
WEIGHTS = 1e-3 * np.array([4.26, -0.91, -20.99, -33.82, -0.80, 0.14, -1.19, -2.30, 0.76])
LENGTH, TIME = np.log(0.02), np.log(0.05)  # ln of m, s, about which the fit is made
MOST = 7e-3  # m
SPARED, SHARE = 1e-3, 0.4  # m that edges may be off, and share of the rest that d takes


def rolled(belief: Belief) -> Array:
    """Final offset of the edges minus d (n,) [m] that strips of this `belief` are expected to make.

    A fold rolls on by half of it until what hangs from the gripper lies; friction holds it. One
    that would roll back is pulled along by the lay, and counts as 0.
    """
    logs = (belief.log_bending_length, belief.log_retardation_time, belief.friction)
    expected = terms(*(mean_and_sigma[:, 0] for mean_and_sigma in logs)) @ WEIGHTS
    return np.asarray(np.clip(expected, 0.0, MOST))


def terms(log_length: Array, log_time: Array, friction: Array) -> Array:
    """What the roll depends on (n, 9), by the logarithms (n,) that a belief holds."""
    length, time = log_length - LENGTH, log_time - TIME
    products = (length**2, length**3, time, time**2, length * time, friction, friction * time)
    return np.stack([np.ones_like(length), length, *products], axis=1)


def wanted(belief: Belief) -> Array:
    """Displacements (n,) [m] to fold to, so that touch and final offset are both small."""
    return -SHARE * np.maximum(rolled(belief) - SPARED, 0.0)
