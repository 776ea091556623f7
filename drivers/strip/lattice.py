"""Where the nodes of a strip lie: at equal steps, finer towards the grip."""

import numpy as np

from drivers.types import Array


def graded(length: float, pieces: int, share: float, finest: float) -> Array:
    """Arc lengths of the nodes (pieces + 1,) [m] of `pieces` pieces, equal but for a `share`
    before the grip, in which they shrink towards `finest` times the others.

    A taut strip bends to the grip's pitch within sqrt(EI / T), a millimetre or two, and where it
    leaves the desk hangs on the length lost in that bend.
    """
    before_grip = (pieces - 0.5 - np.arange(pieces)) / pieces
    spans = np.minimum(1.0, finest ** (1.0 - before_grip / share))
    arc = np.concatenate([[0.0], np.cumsum(spans)])
    return np.asarray(arc * (length / arc[-1]))
