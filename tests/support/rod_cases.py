"""Strips and gripper motions for tests of the rod."""

from collections.abc import Sequence

import numpy as np

from drivers.base.types import Array
from drivers.strip.describe import describe
from drivers.strip.file import paper_damping_minimum, paper_strip
from drivers.strip.model import StripModel
from drivers.strip.rod import layout as at
from drivers.strip.rod.batch import flat_batch, midlines
from drivers.strip.rod.lumping import check
from drivers.strip.rod.static import settle
from policies.path import Path

STIFFNESS = np.geomspace(0.02, 0.3, 5)
DAMPING = np.geomspace(1.0, 50.0, 5)
Effects = dict[str, dict[str, float]]


def paper_model(
    k: float, times_minimum: float = 1.0, effects: Effects | None = None
) -> StripModel:
    """Model of the paper's strip with joint stiffness k and `times_minimum` its
    damping.
    """
    damping = times_minimum * paper_damping_minimum(k)
    return describe(paper_strip(k, damping, effects=effects or {}))


def paper_grid() -> list[StripModel]:
    """Models over the paper's range, 5 x 5 on a logarithmic grid."""
    return [paper_model(k, b) for k in STIFFNESS for b in DAMPING]


def steady(path: Path, dt: float, speed: float = 0.1) -> Array:
    """Poses (k, 3) along `path` at constant speed from the first step on."""
    steps = np.arange(1, int(path.length / speed / dt) + 1)
    return path.poses(np.minimum(steps * dt * speed, path.length))


def for_all(poses: Array, count: int) -> Array:
    """The same poses (k, 3) for each of `count` strips (k, count, 3)."""
    return np.repeat(poses[:, None], count, axis=1)


def overhang(models: Sequence[StripModel], segments: int = 100) -> Array:
    """Midlines (n, nodes, 2) [m] of strips clamped flat at x = 0 that hang free from
    there.

    The cantilever of ASTM D1388 and of heavy-elastica theory; there is no desk.
    """
    check(models)
    batch = flat_batch(models, segments)
    end = segments + 1
    batch.nature[:, :, at.DESK] = 0.0
    bending = [at.BEND, at.DAMP, at.SLIP, at.STICK]
    rich = [at.QUADRATIC, at.BRANCH, at.GRADUAL_SLIP]
    for field in bending if batch.terms is None else [*bending, *rich]:
        batch.nature[:, end, field] = 0.0
    free = batch._replace(last=end)
    settle(free, free.grip[None].copy())
    return midlines(free)
