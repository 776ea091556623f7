"""Computes the path of an arm that follows a planned motion from a flat start, corners rounded."""

import numpy as np

from drivers.geometry import arc_lengths
from drivers.strip.rod.motions import GripperPath
from drivers.types import Array, frozen
from policies.experiments.motion import Motion
from policies.path import lift_pitch

STEP = 0.001  # s
ROW_STRIDE = 10  # steps between the rows that an arm reports
CORNER_TIME = 0.04  # s before and after a corner in which the arm turns its velocity
DWELL_TIME = 0.6  # s at the end of a motion in which the arm stays


def reported_path(motion: Motion) -> GripperPath:
    """Reported times (m,) [s] from 0 and poses (m, 3) of `motion`, from rest to rest."""
    t = np.arange(0.0, motion.duration + 2 * CORNER_TIME + DWELL_TIME, STEP)
    half = round(CORNER_TIME / STEP)
    window = np.hanning(2 * half + 3)[1:-1]  # without the zeros at its ends
    points = motion.at(np.clip(t - CORNER_TIME, 0.0, motion.duration))
    places = np.stack([_smooth(points[:, c], window / window.sum()) for c in range(2)], axis=1)
    travel = arc_lengths(places)
    poses = np.column_stack([places, lift_pitch(travel)])
    return GripperPath(frozen(t[::ROW_STRIDE]), frozen(poses[::ROW_STRIDE]))


def _smooth(values: Array, window: Array) -> Array:
    half = len(window) // 2
    return np.convolve(np.pad(values, half, mode="edge"), window, mode="valid")
