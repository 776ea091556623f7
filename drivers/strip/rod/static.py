"""Strips at rest: hung from a gripper, or over an edge as textile laboratories test them."""

from collections.abc import Sequence

import numpy as np

from drivers.errors import SimulationNotConverged
from drivers.strip.model import StripModel
from drivers.strip.rod import follow as of
from drivers.strip.rod import layout as at
from drivers.strip.rod.batch import laid_flat, midlines
from drivers.strip.rod.follow import Batch, follow
from drivers.strip.rod.lumping import check
from drivers.strip.rod.step import Pace
from drivers.types import Array

APPROACH = 60  # steps from lying flat to where a strip hangs
PERIOD = 0.05  # s, Euler steps in which a strip comes to where it shall rest
STILLING = tuple(PERIOD * 2**i for i in range(10))  # s, those in which it comes to rest


def lifted(batch: Batch, start: Array) -> Array:
    """A way (k, n, 3) of grips from where strips lie flat to `start` (n, 3): first up, then in.

    The height grows with the root of the way in, so that the edge stays within the strip's reach.
    """
    share = np.linspace(0.0, 1.0, APPROACH + 1)[1:, None]
    way = batch.held + share[:, :, None] * (start - batch.held)
    way[:, :, 1] = np.sqrt(share) * start[:, 1]
    return np.asarray(way)


def settle(batch: Batch, way: Array) -> None:
    """Bring the grips along `way` (k, n, 3), `PERIOD` a step, and let the strips come to rest."""
    _euler(batch, way, PERIOD)
    for longer in STILLING:
        _euler(batch, way[-1:], longer)


def overhang(models: Sequence[StripModel], segments: int = 100) -> Array:
    """Midlines (n, nodes, 2) [m] of strips clamped flat at x = 0 that hang free from there.

    The cantilever of ASTM D1388 and of heavy-elastica theory; there is no desk.
    """
    check(models)
    batch = laid_flat(models, segments)
    end = segments + 1
    batch.nature[:, :, at.DESK] = 0.0
    for field in (at.BEND, at.DAMP, at.SLIP, at.STICK):
        batch.nature[:, end, field] = 0.0
    free = batch._replace(last=end)
    settle(free, free.held[None].copy())
    return midlines(free)


def _euler(batch: Batch, poses: Array, dt: float) -> None:
    shown = np.zeros((len(poses), len(batch.held), of.SHOWN))
    follow(batch, poses, shown, np.empty((0, 0, 0, 2)), 1, 0.0, Pace(dt, 0.0, 0.0))
    failed, touched = (np.isfinite(batch.known[:, field]) for field in (of.FAILED, of.TIME))
    if failed.any():
        raise SimulationNotConverged("rod", int(np.argmax(failed)), 0.0)
    if touched.any():
        raise ValueError(f"the layers of strip {int(np.argmax(touched))} touch before it rests")
