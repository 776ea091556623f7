"""Node positions along a strip: equal spacing, refined towards the grip."""

import numpy as np

from drivers.types import Array


def graded_nodes(length: float, pieces: int, share: float, finest: float) -> Array:
    """Arc lengths (pieces + 1,) [m] of nodes that are equally spaced, closer near the grip.

    Over the last `share` of the segments their length shrinks to `finest` times the others'. Near
    the grip a taut strip bends within sqrt(EI / T), a millimetre or two; where it leaves the desk
    depends on the length of that bend.
    """
    before_grip = (pieces - 0.5 - np.arange(pieces)) / pieces
    spans = np.minimum(1.0, finest ** (1.0 - before_grip / share))
    arc = np.concatenate([[0.0], np.cumsum(spans)])
    return np.asarray(arc * (length / arc[-1]))
