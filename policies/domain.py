"""The paper's range of strips: stiffness and damping of its joints, sampled or on a grid."""

import numpy as np

from drivers.strip.file import StripFile, paper_damping_minimum, paper_strip
from drivers.types import Array

STIFFNESS_RANGE = (0.02, 0.3)  # N m/rad (paper, appendix)
DAMPING_RATIO = 50.0  # largest damping over the smallest at the same stiffness (paper, appendix)


def strip_at(u: float, v: float) -> StripFile:
    """The strip at (u, v) of the unit square, on which log stiffness and log damping are linear."""
    low, high = STIFFNESS_RANGE
    k = low * (high / low) ** u
    return paper_strip(k, paper_damping_minimum(k) * DAMPING_RATIO**v)


def grid(n: int) -> list[StripFile]:
    """n x n strips on a logarithmic grid with corners, stiffness outermost."""
    places = np.linspace(0.0, 1.0, n)
    return [strip_at(u, v) for u in places for v in places]


def sample(n: int, rng: np.random.Generator) -> list[StripFile]:
    """n x n strips, one at random in each cell of the unit square (stratified sampling)."""
    shift: Array = rng.uniform(size=(n, n, 2))
    cells = np.stack(np.meshgrid(np.arange(n), np.arange(n), indexing="ij"), axis=-1)
    places = ((cells + shift) / n).reshape(-1, 2)
    return [strip_at(u, v) for u, v in places]
