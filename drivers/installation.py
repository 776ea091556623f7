"""Installation of an arm in a cell: mounting, motion limits, workspace."""

from math import pi

from pydantic import Field

from drivers.geometry import CellInRobot
from drivers.limits import MotionLimits, Workspace
from drivers.settings import Settings


class Mounting(Settings):
    """Pose of the cell frame in the robot's base: origin [m] and yaw of its x-axis [rad].

    By default the strip lies crosswise in front of the robot, centred, on a desk above the robot's
    base, so that the hand lies flat over both of its ends.
    """

    x: float = Field(0.36, ge=-2, le=2)
    y: float = Field(-0.3, ge=-2, le=2)
    z: float = Field(0.1, ge=-1, le=1)
    yaw: float = Field(pi / 2, ge=-pi, le=pi)

    def transform(self) -> CellInRobot:
        """Rigid transform from the cell frame to the robot's base."""
        return CellInRobot.from_yaw(self.x, self.y, self.z, self.yaw)


class Installation(Settings):
    """Mounting, limits and workspace of an arm in this cell, and the x at which `desk` ends [m]."""

    limits: MotionLimits = MotionLimits()
    workspace: Workspace = Workspace()
    mounting: Mounting = Mounting()
    desk: float | None = Field(None, gt=0, le=3, exclude_if=lambda end: end is None)
