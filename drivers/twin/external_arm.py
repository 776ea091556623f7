"""Simulated strip and camera beside any arm, moved by its measured poses and its hand."""

from collections.abc import Callable

import numpy as np

from drivers.geometry import CellInRobot
from drivers.protocols import Hand
from drivers.twin.clock import Rank
from drivers.twin.open import Desk
from drivers.twin.settings import HandSettings
from drivers.twin.world import Fingers
from drivers.types import Array, Pose

PERIOD = 0.005  # s
BEHIND = 0.005  # s that a measured pose may be old before the gripper counts as resting there

Seen = Callable[[], tuple[float, Pose] | None]


class ExternalArm:
    """Moves the gripper in the world of `desk` to the poses that the arm measured.

    `seen` gives the arm's newest stamp [s] and pose, None while it is not connected. In return the
    emulated hand gets the thickness `between` its fingers and the arm the `force` of the strip.
    """

    def __init__(
        self, desk: Desk, settings: HandSettings, seen: Seen, hand: Hand, frame: CellInRobot
    ) -> None:
        self._world = desk.world
        self._settings = settings
        self._seen = seen
        self._hand = hand
        self._turn: Array = frame.matrix[:3, :3]
        self._pose = desk.home
        self._thickness = desk.model.mechanics.thickness
        desk.clock.every(PERIOD, self._follow, Rank.SERVO)

    def between(self) -> float | None:
        """Thickness [m] of the material between the fingers; None for nothing."""
        held = self._world.holds_strip
        if held or self._world.edge_within(self._settings.reach, self._settings.lean):
            return self._thickness
        return None

    def force(self, tip: Array, time: float) -> Array:  # noqa: ARG002
        """Weight (3,) [N] of the strip on the gripper, in the robot's base."""
        return np.asarray(self._turn @ (0.0, 0.0, -self._world.load), dtype=np.float64)

    def _follow(self, now: float) -> None:
        seen = self._seen()
        if seen is None:
            self._world.follow(now, self._pose)
            return
        stamp, self._pose = seen
        self._world.follow(max(stamp, now - BEHIND), self._pose)
        hand = self._hand.state()
        self._world.move_fingers(Fingers(hand.width, hand.width, start=now, speed=1.0))
        if hand.grasped and not self._world.holds_strip and self.between() is not None:
            self._world.attach()
        elif not hand.grasped and self._world.holds_strip:
            self._world.detach()
