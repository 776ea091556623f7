"""Pose of the strip's edge in the grip, and the gripper's true pose."""

from dataclasses import dataclass
from math import cos, sin
from typing import Self

from drivers.strip.grip_path import share_away, true_poses
from drivers.strip.model import Rig
from drivers.types import Pose


@dataclass(frozen=True, slots=True)
class Grip:
    """A rigid grasp: position `along`, `across` [m] and `turn` [rad] of the edge in the hand."""

    along: float
    across: float
    turn: float

    @classmethod
    def between(cls, hand: Pose, edge: Pose) -> Self:
        """The grasp of a hand at pose `hand` that closed on an edge at pose `edge`."""
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
    """Converter of reported gripper poses to true poses over the true desk.

    The offsets of `rig` grow as in `grip_path`: from zero at the grasp.
    """

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        self._start: Pose | None = None
        self._share = 0.0

    def grasp(self, reported: Pose) -> None:
        """Set `reported` as the pose of the grasp, from which on offsets grow with the distance."""
        self._start = reported

    def advance(self, reported: Pose) -> Pose:
        """The true pose of a gripper that has moved to the pose `reported`."""
        if self._start is not None:
            share = share_away(reported.as_array(), self._start.as_array())
            self._share = max(self._share, float(share))
        return self.true(reported)

    def true(self, reported: Pose) -> Pose:
        """The true pose of a gripper at the pose `reported`, with the offsets grown so far."""
        if self._share == 0:
            return reported
        x, z, pitch = true_poses(self._rig, reported.as_array(), self._share).tolist()
        return Pose(x, z, pitch)
