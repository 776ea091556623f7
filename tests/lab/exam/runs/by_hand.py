"""Gripper paths of motions led by a person's hand, with tremor."""

import numpy as np

from cell.gap.subject.strip.synthetic import ROW_STRIDE
from drivers.geometry import arc_lengths
from drivers.strip.rod.motions import GripperPath
from drivers.types import Array, frozen
from policies.experiments.by_hand import STEP, generator, hand_path, wavering
from policies.path import lift_pitch

TREMOR = 0.0002  # m, one sigma in x and in z
SHIVER = (1.0, 5.0)  # Hz


def paths_by_hand(length: float, seed: int, count: int) -> list[GripperPath]:
    """Gripper paths of `count` motions by hand over a strip of `length` [m], set by `seed`."""
    return [_reported_path(length, generator(seed, i)) for i in range(count)]


def _reported_path(length: float, rng: np.random.Generator) -> GripperPath:
    line, travel = hand_path(length, rng)
    t: Array = STEP * np.arange(len(travel), dtype=float)
    share = travel / line.x[-1]
    fading = (4.0 * share * (1.0 - share))[:, None]  # a gripper that grasps or is done stands still
    tremor = np.stack([wavering(t, SHIVER, rng) for _ in range(2)], axis=1)
    places = line(travel) + TREMOR * np.clip(fading, 0.0, 1.0) * tremor
    poses = np.column_stack([places, lift_pitch(arc_lengths(places))])
    return GripperPath(frozen(t[::ROW_STRIDE]), frozen(poses[::ROW_STRIDE]))
