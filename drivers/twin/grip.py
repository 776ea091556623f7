"""Pose of the strip's edge in the grip, and the gripper's true pose."""

from dataclasses import dataclass
from math import cos, sin
from typing import Self

from drivers.strip.grip_path import share_away, true_poses
from drivers.strip.model import Rig
from drivers.types import Pose


@dataclass(frozen=True, slots=True)
class Grip:
    """A rigid hold: the edge at `along`, `across` [m] in the hand's frame,
    turned by `turn` [rad].
    """

    along: float
    across: float
    turn: float

    @classmethod
    def between(cls, hand: Pose, edge: Pose) -> Self:
        """The hold of a `hand` that closed on `edge`."""
        dx, dz = edge.x - hand.x, edge.z - hand.z
        c, s = cos(hand.pitch), sin(hand.pitch)
        return cls(c * dx + s * dz, c * dz - s * dx, edge.pitch - hand.pitch)

    def edge(self, hand: Pose) -> Pose:
        """Pose of the strip's edge while the hand is at `hand`."""
        c, s = cos(hand.pitch), sin(hand.pitch)
        return Pose(
            hand.x + c * self.along - s * self.across,
            hand.z + s * self.along + c * self.across,
            hand.pitch + self.turn,
        )


class RigOffsets:
    """The gripper's true pose over the true desk from the pose that the arm reports.

    The offsets of `rig` grow as in `grip_path`: from zero at the grasp.
    """

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        self._start: Pose | None = None
        self._share = 0.0

    def grasp(self, believed: Pose) -> None:
        """The strip is grasped here: from now on offsets grow with the distance."""
        self._start = believed

    def advance(self, believed: Pose) -> Pose:
        """The true pose of a gripper that has moved to the reported pose `believed`."""
        if self._start is not None:
            share = share_away(believed.as_array(), self._start.as_array())
            self._share = max(self._share, float(share))
        return self.true(believed)

    def true(self, believed: Pose) -> Pose:
        """The true pose, with the offsets grown so far."""
        if self._share == 0:
            return believed
        x, z, pitch = true_poses(self._rig, believed.as_array(), self._share).tolist()
        return Pose(x, z, pitch)
