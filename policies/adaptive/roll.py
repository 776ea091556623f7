"""How far the loop rolls on after the touch, and how much of it the fold makes up for."""

import numpy as np

from drivers.types import Array
from policies.adaptive.critic import Belief

# Of the final offset of the edges minus d [m], of chains of 80 links whose edge was laid where it
# pulls nothing along: least squares over 60 strips, half with yarn friction, 2.3 mm rms
# (`python -m tests.benchmarks.measure_roll 60`).
MEAN, OF_LENGTH, OF_TIME, OF_FRICTION = 3.21e-3, -1.39e-3, -0.71e-3, -3.03e-3
OF_LENGTH_AND_TIME, OF_LENGTH_AND_FRICTION = -2.71e-3, -4.87e-3
LENGTH, TIME = np.log(0.02), np.log(0.05)  # ln of m, s, about which the fit is made
MOST = 5e-3  # m
SHARE = 0.3  # of it that the fold is displaced to the other side: d and offset both stay small


def rolled(belief: Belief) -> Array:
    """Final offset of the edges minus d (n,) [m] that strips of this `belief` are expected to make.

    A fold rolls on by half of it until what hangs from the gripper lies; friction holds it. One
    that would roll back is pulled along by the lay, and counts as 0.
    """
    length = belief.log_bending_length[:, 0] - LENGTH
    time = belief.log_retardation_time[:, 0] - TIME
    friction = belief.friction[:, 0]
    expected = MEAN + OF_LENGTH * length + OF_TIME * time + OF_FRICTION * friction
    expected += length * (OF_LENGTH_AND_TIME * time + OF_LENGTH_AND_FRICTION * friction)
    return np.asarray(np.clip(expected, 0.0, MOST))


def wanted(belief: Belief) -> Array:
    """Displacements (n,) [m] to fold to, so that touch and final offset are both small."""
    return -SHARE * rolled(belief)
