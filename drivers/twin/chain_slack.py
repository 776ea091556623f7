"""How a strip comes to lie that is longer or shorter than stated."""

import numpy as np

from drivers.strip.model import StripModel
from drivers.types import Array

APPROACH, REST = 120, 280  # steps on the way in, and until the strip lies still
STILLING = 0.9  # of the motion that a step leaves, meanwhile
HEIGHT = 0.7  # of the way in over what a slack strip allows


def brought_in(model: StripModel) -> Array:
    """Poses (k, 3) of a grip that takes the edge from where it lies to the stated place.

    A slack strip is entered from above, so that its slack lies as a wave before the grip; a
    short one is pulled taut. None for a strip that is as long as stated.
    """
    length, stated = model.mechanics.length, model.stated_length
    slack = length - stated
    if slack == 0:
        return np.empty((0, 3))
    share = np.concatenate([np.linspace(0.0, 1.0, APPROACH + 1)[1:], np.ones(REST)])
    reach = np.sqrt(2 * length * max(slack, 0.0))
    height = HEIGHT * reach * np.sqrt(share * (1 - share))
    return np.stack([length - slack * share, height, np.zeros_like(share)], axis=1)
