"""Initial weights of the search: a network that draws a raised triangle."""

import numpy as np

from drivers.types import Array
from policies.network import CENTRE, HIDDEN, INPUTS, SPREAD

APEX = 0.5  # of the strip's length, where the heading turns
TURN = 0.06  # of the strip's length, over which it turns
RISING, FALLING = 0.73, 1.25  # headings over pi of the two legs


def first_weights(rng: np.random.Generator) -> Array:
    """Weights (WEIGHTS,): one unit turns the heading at the apex, the others are zero.

    y = (FALLING + RISING - 2) - (FALLING - RISING) tanh((x - APEX) / TURN), phi = pi (1 + y / 2).
    """
    inward = rng.normal(size=(HIDDEN, INPUTS))
    bias = rng.normal(size=HIDDEN)
    inward[0] = np.array([1.0, 0.0, 0.0]) @ np.array(SPREAD) / TURN
    bias[0] = (CENTRE[0] - APEX) / TURN
    outward = np.zeros(HIDDEN)
    outward[0] = -(FALLING - RISING)
    return np.concatenate([inward.ravel(), bias, outward, [FALLING + RISING - 2.0]])
