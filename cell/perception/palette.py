"""Colours of a strip, sampled where it lies."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.types import Array, frozen

MOST_COLOURS = 4  # colours that a strip may have
COLOUR_SPREAD = 6.0  # grey levels by which weave and noise scatter one colour
SHADE = 0.06  # share of brightness by which weave and light vary over a resting strip
OTHER_COLOUR = 3.0  # standard deviations from which a sample is of another colour
BLENDS = 0.08  # share of samples that may lie between colours
ROUNDS = 12

Indices = NDArray[np.signedinteger[Any]]


def palette(samples: Array) -> Array:
    """Smallest set of colours (k, 3), most frequent first, that explains `samples` (n, 3).

    At most MOST_COLOURS. Samples between two colours, as at the border of a stripe, may stay
    unexplained.
    """
    colours = np.median(samples, axis=0)[None]
    while match_none(samples, colours).mean() > BLENDS and len(colours) < MOST_COLOURS:
        colours = _refine(samples, np.vstack([colours, _farthest(samples, colours)]))
    nearest = _standard_distances(samples, colours).argmin(axis=1)
    frequent = np.argsort(-np.bincount(nearest, minlength=len(colours)), kind="stable")
    return frozen(colours[frequent])


def match_none(samples: Array, colours: Array) -> NDArray[np.bool_]:
    """Mask (n,) of the samples (n, 3) that match none of the colours (k, 3)."""
    return np.asarray(_standard_distances(samples, colours).min(axis=1) > OTHER_COLOUR)


def _standard_distances(samples: Array, colours: Array) -> Array:
    """Distances (n, k) [sigma] of `samples` from `colours`; brightness counts less than colour."""
    away = samples[:, None] - colours
    bright = colours / np.maximum(np.linalg.norm(colours, axis=1), 1.0)[:, None]
    along = (away * bright).sum(axis=2)
    aside = (away**2).sum(axis=2) - along**2
    stretch = COLOUR_SPREAD**2 + SHADE**2 * (colours**2).sum(axis=1)
    return np.asarray(np.sqrt(np.maximum(aside, 0.0) / COLOUR_SPREAD**2 + along**2 / stretch))


def _farthest(samples: Array, colours: Array) -> Array:
    """Median colour (3,) of the twentieth of the samples nearest to the worst explained one."""
    distance = _standard_distances(samples, colours).min(axis=1)
    worst = samples[int(np.argmax(distance))]
    near = np.argsort(np.linalg.norm(samples - worst, axis=1), kind="stable")
    return np.asarray(np.median(samples[near[: max(len(samples) // 20, 1)]], axis=0))


def _refine(samples: Array, colours: Array) -> Array:
    """Move each colour (k, 3) to the median of its nearest samples, until convergence."""
    for _ in range(ROUNDS):
        nearest: Indices = _standard_distances(samples, colours).argmin(axis=1)
        medians = colours.copy()
        for k in np.unique(nearest):
            medians[k] = np.median(samples[nearest == k], axis=0)
        if np.allclose(medians, colours, atol=0.1):
            break
        colours = medians
    return colours
