"""Groups readings near in time into blocks, and averages each block to one sample."""

import numpy as np
from numpy.typing import NDArray

from drivers.types import Array

PER_BLOCK = 16  # readings used of a block at most


def blocks(t: Array, width: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Split readings at times t (n,) [s] into b blocks of `width` [s], thinned to PER_BLOCK each.

    Returns the edges (b + 1,) of the blocks among the kept readings, and the indices (k,) of those.
    """
    starts = np.flatnonzero(np.diff(np.floor(t / width))) + 1
    chosen = [inside if len(inside) <= PER_BLOCK
              else inside[np.linspace(0, len(inside) - 1, PER_BLOCK).round().astype(int)]
              for inside in np.split(np.arange(len(t)), starts)]  # fmt: skip
    return np.cumsum([0, *map(len, chosen)]), np.concatenate(chosen)


def average(values: Array, edges: NDArray[np.int64]) -> tuple[Array, Array]:
    """Mean and mean square of `values` (n, k) within blocks, each flattened to (n b,)."""
    counts = np.diff(edges)
    mean = np.add.reduceat(values, edges[:-1], axis=1) / counts
    square = np.add.reduceat(values**2, edges[:-1], axis=1) / counts
    return mean.ravel(), square.ravel()
