"""Lengths along polylines, sizes of errors, and the transform between the cell frame
and the robot's base frame.
"""

from dataclasses import dataclass
from math import cos, sin
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from drivers.base.types import Array

# m by which an edge is held before the middle between the pads: with less of the
# fingers beyond it, the edge can be laid lower
EDGE_AHEAD = 0.004
MAD = 1.4826  # standard deviation of normal errors over their median absolute deviation


@dataclass(frozen=True, slots=True)
class CellInRobot:
    """Rigid transform from the cell frame (x along the strip, z up) to the robot
    base.
    """

    matrix: Array

    @classmethod
    def from_yaw(cls, x: float, y: float, z: float, yaw: float) -> Self:
        """Transform of a cell frame with origin (x, y, z) [m] and its x-axis at `yaw`
        [rad].
        """
        c = np.cos(yaw)
        s = np.sin(yaw)
        return cls(
            np.array([[c, -s, 0, x], [s, c, 0, y], [0, 0, 1, z], [0, 0, 0, 1.0]])
        )

    def to_robot(
        self, x: float, z: float, pitch: float, *, turned: bool = False
    ) -> Array:
        """Pose (4, 4) in the base of a hand that holds an edge at x, z [m] and `pitch`
        [rad].

        Its tool's point, the middle between the pads, is EDGE_AHEAD behind that edge.
        The hand's approach axis is its z-axis; at pitch pi/2 it points straight down.
        Its fingers open along its y-axis, which lies in the strip's plane too. `turned`
        rotates the hand by half a turn about its approach axis.
        """
        side = -1.0 if turned else 1.0
        c = cos(pitch - np.pi / 2)
        s = sin(pitch - np.pi / 2)
        in_cell = np.array(
            [
                [0, -side * c, s, x - EDGE_AHEAD * s],
                [-side, 0, 0, 0],
                [0, -side * s, -c, z + EDGE_AHEAD * c],
                [0, 0, 0, 1],
            ]
        )
        pose: Array = self.matrix @ in_cell
        return pose

    def to_cell(self, pose: Array) -> tuple[float, float, float]:
        """x, z [m] of the held edge, pitch [rad] in the cell frame of a hand at `pose`
        (4, 4) in the base, turned or not.
        """
        in_cell = np.linalg.solve(self.matrix, pose)
        pitch = np.pi / 2 + np.arctan2(in_cell[0, 2], -in_cell[2, 2])
        x, _, z = in_cell[:3, 3] + EDGE_AHEAD * in_cell[:3, 2]
        return float(x), float(z), float(pitch)


def arc_lengths(points: Array) -> Array:
    """Distances (n,) [m] of `points` (n, 2) [m] from the first, along the polyline."""
    return running_sums(lengths(np.diff(points, axis=0)))


def running_sums(steps: Array) -> Array:
    """Sums (n + 1, ...) of the first 0 to n of the `steps` (n, ...)."""
    return np.concatenate([np.zeros((1, *steps.shape[1:])), steps.cumsum(axis=0)])


def lengths(vectors: NDArray[Any]) -> Array:
    """Lengths (...,) of `vectors` (..., 2)."""
    sizes: Array = np.hypot(*np.moveaxis(vectors, -1, 0))
    return sizes


def left_normals(directions: Array) -> Array:
    """Vectors (n, 2) that are `directions` (n, 2) turned by a quarter turn to the
    left.
    """
    return np.stack([-directions[:, 1], directions[:, 0]], axis=1)


def unit(vectors: Array) -> Array:
    """Vectors (n, 2) of length 1 along `vectors` (n, 2), of which none may be zero."""
    directions: Array = vectors / lengths(vectors)[:, None]
    return directions


def rotation(angle: float) -> Array:
    """Rotation matrix (2, 2) that turns a plane by `angle` [rad]."""
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def moving_average(points: Array, window: int) -> Array:
    """Means (n - window + 1, 2) [m] of every `window` successive ones of `points` (n,
    2) [m].
    """
    sums = running_sums(points)
    means: Array = (sums[window:] - sums[:-window]) / window
    return means


def even_points(points: Array, count: int) -> Array:
    """Points (count, 2) [m] at equal arc lengths along the polyline through `points`
    (n, 2) [m].
    """
    travel = arc_lengths(points)
    distances = np.linspace(0.0, travel[-1], count)
    return interpolate_columns(distances, travel, points)


def interpolate_columns(at: Array | float, x: Array, columns: Array) -> Array:
    """Values (..., k) of `columns` (n, k), given at increasing `x` (n,), at the places
    `at` (...,).

    Linear in between, held beyond the first and the last.
    """
    return np.stack([np.interp(at, x, column) for column in columns.T], axis=-1)


def robust_sigma(errors: Array) -> float:
    """Standard deviation of `errors` (n,) about zero, in their unit, by their median
    size.

    Consistent for normal errors; outliers hardly change it.
    """
    return MAD * float(np.median(np.abs(errors)))
