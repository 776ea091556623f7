"""How far the loop rolls on after the touch, and how much of it the fold makes up for."""

import numpy as np

from drivers.types import Array
from policies.adaptive.critic import Belief

# Of the final offset of the edges minus d [m], of chains of 80 links whose edge was laid where it
# pulls nothing along: least squares over 60 strips, half with yarn friction, 1.3 mm rms
# (`python -m tests.benchmarks.measure_roll 60`).
MEAN, OF_LENGTH, OF_SQUARE = 4.02e-3, -2.88e-3, -31.9e-3
OF_TIME, OF_LENGTH_AND_TIME, OF_FRICTION = -0.34e-3, -2.62e-3, -2.87e-3
LENGTH, TIME = np.log(0.02), np.log(0.05)  # ln of m, s, about which the fit is made
MOST = 6e-3  # m
SPARED, SHARE = 1e-3, 0.5  # m that edges may be off, and share of the rest that d takes


def rolled(belief: Belief) -> Array:
    """Final offset of the edges minus d (n,) [m] that strips of this `belief` are expected to make.

    A fold rolls on by half of it until what hangs from the gripper lies; friction holds it. One
    that would roll back is pulled along by the lay, and counts as 0.
    """
    length = belief.log_bending_length[:, 0] - LENGTH
    time = belief.log_retardation_time[:, 0] - TIME
    expected = MEAN + OF_LENGTH * length + OF_SQUARE * length**2
    expected += OF_TIME * time + OF_LENGTH_AND_TIME * length * time
    expected += OF_FRICTION * belief.friction[:, 0]
    return np.asarray(np.clip(expected, 0.0, MOST))


def wanted(belief: Belief) -> Array:
    """Displacements (n,) [m] to fold to, so that touch and final offset are both small."""
    return -SHARE * np.maximum(rolled(belief) - SPARED, 0.0)
