"""Gripper paths in the plane of the strip, as polylines with distances along them."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from drivers.base.geometry import arc_lengths, interpolate_columns
from drivers.base.types import Array, frozen
from drivers.strip.observation import LIFT_TRAVEL

TAKEOVER_HEIGHT = 0.10  # m at which a policy takes over from the lift (paper)

# m. Over the paper's range at 0.1 m/s |d| is least in the mean at 40 mm, at worst at 43
# mm.
PAPER_RISE = 0.042


@dataclass(frozen=True, slots=True)
class Path:
    """Gripper path: polyline `points` (m, 2) x, z [m] at distances `travel` (m,) [m]
    along it.
    """

    points: Array
    travel: Array

    @classmethod
    def through(cls, points: Array) -> Self:
        """Path through `points` (m, 2) x, z [m], m at least 2."""
        return cls(frozen(points), frozen(arc_lengths(points)))

    @property
    def length(self) -> float:
        """Length of the path [m]."""
        return float(self.travel[-1])

    def at(self, travel: Array | float) -> Array:
        """Points (..., 2) x, z [m] at distances `travel` (...,) [m], clamped to the
        path's ends.
        """
        return interpolate_columns(travel, self.travel, self.points)

    def poses(self, travel: Array | float) -> Array:
        """Gripper poses (..., 3) x, z [m], pitch [rad] at distances `travel` (...,)
        [m].
        """
        return np.concatenate([self.at(travel), lift_pitch(travel)[..., None]], axis=-1)


def lift_pitch(travel: Array | float) -> Array:
    """Pitch (...,) [rad] after `travel` (...,) [m] from a flat start: proportional up
    to pi/2.
    """
    return np.pi / 2 * np.clip(np.asarray(travel) / LIFT_TRAVEL, 0.0, 1.0)


def triangular(length: float, rise: float = 0.0) -> Path:
    """Triangular path (L, 0), (L/2, L/2 + rise), (0, rise) [m] over a strip of `length`
    L [m].

    Without a rise it is exact for limp strips (paper, state of the art).
    """
    apex = (length / 2, length / 2 + rise)
    return Path.through(np.array([(length, 0.0), apex, (0.0, rise)]))


def shifted(length: float) -> Path:
    """Triangular path over a strip of `length` [m], raised by PAPER_RISE [m] for every
    fabric.
    """
    return triangular(length, PAPER_RISE)


def vertical_lift(length: float) -> Path:
    """Path over a strip of `length` L [m] from (L, 0) straight up, then at 45 degrees
    to z = L/2.

    The triangle's first leg pushes the strip back along the desk until it buckles at
    the grip, to curvatures of up to 180 1/m, of which friction between yarns keeps a
    part; on this parabola they stay under 20 1/m.
    """
    z = np.linspace(0.0, TAKEOVER_HEIGHT, 41)
    # a parabola whose slope at the take-over is 1
    x = length - z**2 / (2 * TAKEOVER_HEIGHT)
    further = length / 2 - TAKEOVER_HEIGHT
    return Path.through(
        np.append(np.stack([x, z], -1), [(x[-1] - further, length / 2)], axis=0)
    )


def circular(length: float) -> Path:
    """Path over a strip of `length` L [m]: half a circle from (L, 0) to (0, 0)."""
    angle = np.linspace(0.0, np.pi, 361)
    radius = length / 2
    return Path.through(
        np.stack([radius + radius * np.cos(angle), radius * np.sin(angle)], -1)
    )


@dataclass(frozen=True, slots=True)
class FoldLine:
    """Line across a strip of `length` [m] along which it is folded, `at` [m] from its
    grasped edge.

    The fold is a half fold of the strip's last `span` [m], whose fixed edge lies at
    x = `goal` [m].
    """

    length: float
    at: float

    @classmethod
    def of(cls, length: float, at: float | None) -> Self:
        """Line `at` [m] from the grasped edge; across the middle where that is None."""
        return cls(length, length / 2 if at is None else at)

    @property
    def span(self) -> float:
        """Length [m] of the part of the strip that is folded in half."""
        return 2.0 * self.at

    @property
    def goal(self) -> float:
        """Position x [m] at which the grasped edge is to lie in the end."""
        return self.length - self.span

    @property
    def is_half(self) -> bool:
        """Whether the edges come to lie on one another."""
        return self.goal == 0.0
