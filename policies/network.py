"""The paper's network: gripper x, z and desk_contact x in, direction of motion out."""

import math

import numpy as np
import torch
from torch import Tensor, nn

from drivers.types import Array

INPUTS = 3
HIDDEN_UNITS = 20
WEIGHT_COUNT = (INPUTS + 1) * HIDDEN_UNITS + HIDDEN_UNITS + 1

# Over the strip's length: a typical state, and the directions in which states spread around it,
# so that a unit change of any weight means about as much as one of another.
INPUT_CENTRE = (0.57, 0.40, 0.56)
INPUT_SPREAD = ((0.16, 0.0, 0.0), (0.0, 0.11, 0.0), (0.04, -0.08, 0.02))


class HeadingNetwork(nn.Module):
    """One hidden layer of 20 tanh units for each of p candidates, evaluated side by side.

    `weights` (p, WEIGHT_COUNT): per unit three input weights, then the hidden biases, the output
    weights and the output bias.
    """

    def __init__(self, weights: Array) -> None:
        super().__init__()
        flat = torch.tensor(np.atleast_2d(weights), dtype=torch.float64)
        cut = [INPUTS * HIDDEN_UNITS, HIDDEN_UNITS, HIDDEN_UNITS, 1]
        first, first_bias, last, last_bias = torch.split(flat, cut, dim=1)
        self.first = nn.Parameter(
            first.reshape(-1, HIDDEN_UNITS, INPUTS).transpose(1, 2).contiguous()
        )
        self.first_bias = nn.Parameter(first_bias[:, None].contiguous())
        self.last = nn.Parameter(last[..., None].contiguous())
        self.last_bias = nn.Parameter(last_bias[:, None].contiguous())
        self.register_buffer("centre", torch.tensor(INPUT_CENTRE, dtype=torch.float64))
        whiten = np.linalg.inv(np.array(INPUT_SPREAD)).T
        self.register_buffer("whiten", torch.tensor(whiten, dtype=torch.float64))

    def forward(self, state: Tensor) -> Tensor:
        """Directions (p, m) [rad] for states (p, m, 3), lengths over the strip's length."""
        hidden = torch.baddbmm(self.first_bias, self.features(state), self.first).tanh()
        turn = torch.baddbmm(self.last_bias, hidden, self.last)[..., 0]
        return math.pi + 0.5 * math.pi * turn

    def features(self, state: Tensor) -> Tensor:
        """States (..., 3) centred and whitened."""
        centre, whiten = self.get_buffer("centre"), self.get_buffer("whiten")
        return (state - centre) @ whiten
