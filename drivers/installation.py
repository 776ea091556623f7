"""How an arm is installed in a cell: where it stands, how it may move, where it may be."""

from math import pi

from pydantic import Field

from drivers.geometry import CellInRobot
from drivers.limits import MotionLimits, Workspace
from drivers.settings import Settings


class Mounting(Settings):
    """The cell frame in the robot's base: its origin [m] and the turn of its x-axis [rad].

    By default the strip lies sideways before the robot, centred, on a desk that stands higher than
    the robot's foot: so the hand lies flat over both of its ends.
    """

    x: float = Field(0.36, ge=-2, le=2)
    y: float = Field(-0.3, ge=-2, le=2)
    z: float = Field(0.1, ge=-1, le=1)
    yaw: float = Field(pi / 2, ge=-pi, le=pi)

    def transform(self) -> CellInRobot:
        """The rigid transform."""
        return CellInRobot.from_yaw(self.x, self.y, self.z, self.yaw)


class Installation(Settings):
    """What holds for any arm of this cell, simulated or real; stated once, in the cell file."""

    limits: MotionLimits = MotionLimits()
    workspace: Workspace = Workspace()
    mounting: Mounting = Mounting()
