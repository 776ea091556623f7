"""Simulation of motions in one batch, each strip along its gripper path."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from drivers.strip.engine import StripMotion
from drivers.strip.grip_path import true_path
from drivers.strip.model import StripModel
from drivers.strip.rod.engine import Rod, Trace
from drivers.strip.shape import Touch
from drivers.types import Array

PIECE_TIME = 0.5  # s of motion in one compiled call: a batch closes up between calls
ROUNDING = 1e-9  # steps, by which a touch at the end of a step may seem to be after it


class GripperPath(NamedTuple):
    """Reported gripper path: times `t` (m,) [s], `poses` (m, 3); `hanging` if not started flat."""

    t: Array
    poses: Array
    hanging: bool = False

    @property
    def duration(self) -> float:
        """Duration of the path [s]."""
        return float(self.t[-1] - self.t[0])


def simulate_all(
    rod: Rod,
    models: Sequence[StripModel],
    paths: Sequence[GripperPath],
    *,
    dt: float = 0.005,
    every: int = 0,
    precision: type[np.floating] = np.float64,
) -> list[StripMotion]:
    """Simulate each of `models` along its own path in one batch; see `simulate` for one.

    True grip paths follow from the models' rigs. Every `every`th step keeps its shape, 0 for none;
    `shapes` then has (k // every, nodes, 2), rounded to `precision`. A motion ends at its
    layer_touch or at the end of its path.
    """
    paths = [_true_path(model, path) for model, path in zip(models, paths, strict=True)]
    counts = [max(1, round(path.duration / dt)) for path in paths]
    poses = np.stack([_sample(path, dt, max(counts)) for path in paths], axis=1)
    rod.reset(models, _start_poses(models, paths) if any(path.hanging for path in paths) else None)
    stride = every or len(poses) + 1
    kept = [np.empty((count // stride, *rod.arc().shape[1:], 2), precision) for count in counts]
    observed = _follow_in_pieces(rod, poses, counts, dt, every, kept)
    simulated = len(observed[0])
    motions = []
    for i, (path, count, shapes) in enumerate(zip(paths, counts, kept, strict=True)):
        seen = Trace._make([*(channel[:, i] for channel in observed), shapes])
        steps, touch = min(count, simulated), rod.touch[i]
        motions.append(_motion_of_strip(seen, poses[:, i], path, steps, touch, dt, stride))
    return motions


def _follow_in_pieces(
    rod: Rod, poses: Array, counts: Sequence[int], dt: float, every: int, kept: Sequence[Array]
) -> list[Array]:
    """Follow `poses` (k, n, 3) in calls of about PIECE_TIME until all strips have ended.

    Strip i ends after `counts[i]` steps at the latest. Returns the observables of `Trace` but for
    the shapes, each (k, n, ...), and writes every `every`th shape of strip i into `kept[i]`.
    """
    stride = every or len(poses) + 1
    piece = max(1, round(PIECE_TIME / dt) // max(every, 1)) * max(every, 1)
    memory = np.empty((piece // stride, *rod.arc().shape, 2))
    observed = []
    for begin in range(0, len(poses), piece):
        *channels, shapes = rod.follow(poses[begin : begin + piece], dt, every, memory)
        observed.append(channels)
        for i, of_strip in enumerate(kept):
            rows = of_strip[begin // stride :][: len(shapes)]
            rows[:] = shapes[: len(rows), i]
        rod.retire(np.array(counts) <= begin + piece)
        if not rod.living.any():
            break
    return [np.concatenate(pieces) for pieces in zip(*observed, strict=True)]


def _true_path(model: StripModel, path: GripperPath) -> GripperPath:
    t, poses = true_path(model.rig, path.t, path.poses, hanging=path.hanging)
    return path._replace(t=t, poses=poses)


def _sample(path: GripperPath, dt: float, count: int) -> Array:
    """Poses (count, 3) of `path` at the ends of `count` steps of `dt` [s], the last pose held."""
    times = path.t[0] + dt * np.arange(1, count + 1)
    return np.stack([np.interp(times, path.t, path.poses[:, c]) for c in range(3)], axis=-1)


def _start_poses(models: Sequence[StripModel], paths: Sequence[GripperPath]) -> Array:
    flat = [(model.stated_length, 0.0, 0.0) for model in models]
    return np.array(
        [path.poses[0] if path.hanging else lying for path, lying in zip(paths, flat, strict=True)]
    )


def _motion_of_strip(
    seen: Trace,
    poses: Array,
    path: GripperPath,
    count: int,
    touch: Touch | None,
    dt: float,
    stride: int,
) -> StripMotion:
    """Motion of one strip over its first `count` steps, fewer where its layers touched."""
    if touch is not None and touch.time > count * dt:
        touch = None
    if touch is not None:
        count = min(count, int(np.ceil(touch.time / dt - ROUNDING)))
        touch = replace(touch, time=path.t[0] + touch.time)
    return StripMotion(
        t=path.t[0] + dt * np.arange(1, count + 1),
        poses=poses[:count],
        contact_x=seen.contact_x[:count],
        tip=seen.tip[:count],
        holding_force=seen.holding_force[:count],
        grip_force=seen.grip_force[:count],
        shapes=seen.shapes[: count // stride],
        touch=touch,
    )
