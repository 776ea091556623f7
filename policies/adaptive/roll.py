"""How far the loop rolls on after the touch, and how much of it the fold makes up for."""

import math
from dataclasses import dataclass

import numpy as np

from drivers.types import Array
from policies.adaptive.critic import Belief

LENGTH, TIME = math.log(0.02), math.log(0.05)  # ln of m, s, about which the fit is made
TERMS = 9
MOST = 7e-3  # m
SPARED, SHARE = 1e-3, 0.4  # m that edges may be off, and share of the rest that d takes


@dataclass(frozen=True, slots=True)
class Roll:
    """Final offset of the edges minus d, linear in `roll_terms` with `weights` [m].

    A fold rolls on by half of it until what hangs from the gripper lies; friction holds it. One
    that would roll back is pulled along by the lay, and counts as 0.
    """

    weights: tuple[float, ...] = (0.0,) * TERMS

    def of(self, belief: Belief) -> Array:
        """The roll (n,) [m] that strips of this `belief` are expected to make."""
        logs = (belief.log_bending_length, belief.log_retardation_time, belief.friction)
        expected = roll_terms(*(each[:, 0] for each in logs)) @ np.array(self.weights)
        return np.asarray(np.clip(expected, 0.0, MOST))

    def aim(self, belief: Belief) -> Array:
        """Displacements (n,) [m] to fold to, so that touch and final offset are both small."""
        return -SHARE * np.maximum(self.of(belief) - SPARED, 0.0)


def roll_terms(log_length: Array, log_time: Array, friction: Array) -> Array:
    """What the roll depends on (n, TERMS), by the logarithms (n,) that a belief holds."""
    length, time = log_length - LENGTH, log_time - TIME
    products = (length**2, length**3, time, time**2, length * time, friction, friction * time)
    return np.stack([np.ones_like(length), length, *products], axis=1)
