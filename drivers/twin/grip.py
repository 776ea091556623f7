"""How the strip's edge sits between the fingers."""

from dataclasses import dataclass
from math import cos, sin
from typing import Self

from drivers.types import Pose


@dataclass(frozen=True, slots=True)
class Grip:
    """A rigid hold: the edge at `along`, `across` [m] in the hand's frame, turned by `turn` [rad].

    What a hand does to the edge that it holds (an offset, a tilt, compliance, slip) belongs here.
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
        """Where the strip's edge is while the hand is at `hand`."""
        c, s = cos(hand.pitch), sin(hand.pitch)
        return Pose(
            hand.x + c * self.along - s * self.across,
            hand.z + s * self.along + c * self.across,
            hand.pitch + self.turn,
        )
