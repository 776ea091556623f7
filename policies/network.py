"""The paper's network: gripper x, z and desk_contact x in, direction of motion out."""

import math

import numpy as np

from drivers.types import Array

INPUTS = 3
HIDDEN_UNITS = 20
WEIGHT_COUNT = (INPUTS + 1) * HIDDEN_UNITS + HIDDEN_UNITS + 1

# Over the strip's length: a typical state, and the directions in which states spread around it,
# so that a unit change of any weight means about as much as one of another.
INPUT_CENTRE = (0.57, 0.40, 0.56)
INPUT_SPREAD = ((0.16, 0.0, 0.0), (0.0, 0.11, 0.0), (0.04, -0.08, 0.02))
WHITEN = np.linalg.inv(np.array(INPUT_SPREAD)).T


class HeadingNetwork:
    """One hidden layer of 20 tanh units for each of p candidates, evaluated side by side.

    `weights` (p, WEIGHT_COUNT): per unit three input weights, then the hidden biases, the output
    weights and the output bias.
    """

    def __init__(self, weights: Array) -> None:
        cut = np.cumsum([INPUTS * HIDDEN_UNITS, HIDDEN_UNITS, HIDDEN_UNITS])
        first, self._first_bias, self._last, self._last_bias = np.split(
            np.atleast_2d(weights), cut, axis=1
        )
        self._first = first.reshape(-1, HIDDEN_UNITS, INPUTS)

    def __call__(self, state: Array) -> Array:
        """Directions (p, m) [rad] for states (p, m, 3), lengths over the strip's length."""
        whitened = np.einsum("pmi,ij->pmj", state - INPUT_CENTRE, WHITEN)
        # einsum, because rounding by BLAS depends on its threads and on the size of the batch
        drive = np.einsum("pmj,phj->pmh", whitened, self._first) + self._first_bias[:, None]
        turn = np.einsum("pmh,ph->pm", np.tanh(drive), self._last) + self._last_bias
        return np.asarray(math.pi + 0.5 * math.pi * turn)
