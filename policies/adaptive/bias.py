"""Bias of the critic's displacement: predicted minus true, where folds differ from those of its
training.
"""

import math
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field

from drivers.settings import Settings, load
from drivers.types import Array
from policies.adaptive.critic import Belief

UNTRAINED = Path(__file__).with_name("untrained.yaml")
REFERENCE_LOG_LENGTH = math.log(0.02)  # ln of m, about which the fit is made
REFERENCE_THICKNESS = 1e-3  # m, likewise


class Untrained(Settings):
    """One sigma `added` [m] to predictions for what folds hold and no training did: another engine,
    images that are lost, effects. Written by `cell study unknown`: with it, the shares `within_1`
    and `within_2` of its `folds` are within one sigma and 1.96.
    """

    schema_: Literal[1] = Field(1, alias="schema")
    added: float
    within_1: float
    within_2: float
    folds: int
    source: str
    belongs_to: str


@cache
def untrained_spread() -> Untrained:
    """Spread added to predictions outside the training, from this version's data file."""
    return load(UNTRAINED, Untrained)


@dataclass(frozen=True, slots=True)
class Bias:
    """Bias [m]: `always`, `of_length` by the logarithm that a belief holds, and `of_thickness` per
    m beyond 1 mm.

    Afterwards the critic's sigmas are right but for the factor `sigma`; a thickness that nobody
    measured adds `unmeasured` [m], and what no training held adds `untrained` [m].
    """

    always: float = 0.0
    of_length: float = 0.0
    of_thickness: float = 0.0
    sigma: float = 1.0
    unmeasured: float = 0.0
    untrained: float = 0.0

    def of(self, belief: Belief, thickness: float | None) -> Array:
        """Bias (n,) [m] for n folds of this `belief`; `thickness` [m] is None where not known."""
        beyond = np.array(0.0 if thickness is None else thickness - REFERENCE_THICKNESS)
        terms = bias_terms(belief.log_bending_length[:, 0], beyond)
        return np.asarray(terms @ np.array([self.always, self.of_length, self.of_thickness]))

    def sigma_of(self, sigma: Array, thickness: float | None) -> Array:
        """Sigma (n,) [m] after correction, where the critic states `sigma` (n,) [m]."""
        added = np.hypot(self.untrained, self.unmeasured if thickness is None else 0.0)
        return np.hypot(self.sigma * sigma, added)


def bias_terms(log_length: Array, beyond: Array) -> Array:
    """Terms (n, 3) of the bias, by ln of the bending length (n,) and the thickness beyond 1 mm
    (n,) [m].
    """
    length, beyond = np.broadcast_arrays(log_length - REFERENCE_LOG_LENGTH, beyond)
    return np.stack([np.ones_like(length), length, beyond], axis=1)
