"""How far the loop rolls on after the touch, and how much of it the fold makes up for."""

import numpy as np

from drivers.types import Array
from policies.adaptive.critic import Belief

# Of the final offset of the edges minus d [m], after chains of 80 links that are laid down without
# a stop: least squares over 42 strips (`python -m tests.benchmarks.measure_roll`), 1.05 mm rms.
MEAN, OF_LENGTH, OF_TIME, OF_FRICTION = 2.8e-3, -2.35e-3, -0.3e-3, -1.5e-3
LENGTH, TIME = np.log(0.02), np.log(0.05)  # ln of m, s, about which the fit is made
MOST = 5e-3  # m
SHARE = 0.15  # of it that the fold is displaced to the other side: d and offset both stay small


def rolled(belief: Belief) -> Array:
    """Final offset of the edges minus d (n,) [m] that strips of this `belief` are expected to make.

    A fold rolls on by half of it until what hangs from the gripper lies; friction holds it.
    """
    length = belief.log_bending_length[:, 0] - LENGTH
    time = belief.log_retardation_time[:, 0] - TIME
    expected = MEAN + OF_LENGTH * length + OF_TIME * time + OF_FRICTION * belief.friction[:, 0]
    return np.asarray(np.clip(expected, 0.0, MOST))


def wanted(belief: Belief) -> Array:
    """Displacements (n,) [m] to fold to, so that touch and final offset are both small."""
    return -SHARE * rolled(belief)
