"""How an arm is installed in a cell: where it stands, how it may move, where it may be."""

from drivers.limits import MotionLimits, Workspace
from drivers.mounting import Mounting
from drivers.settings import Settings


class Installation(Settings):
    """What holds for any arm of this cell, simulated or real; stated once, in the cell file."""

    limits: MotionLimits = MotionLimits()
    workspace: Workspace = Workspace()
    mounting: Mounting = Mounting()
