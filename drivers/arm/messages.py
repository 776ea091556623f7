"""Messages between the cell and the process that owns the robot's 1 kHz loop."""

from enum import IntEnum
from typing import NamedTuple


class Kind(IntEnum):
    """Kinds of commands to the process that owns the robot."""

    HOLD = 0
    FOLLOW = 1
    MOVE = 2


class Order(NamedTuple):
    """The newest command to the loop: its `kind`, with a velocity or a pose in `a`, `b`, `c`.

    `number` rises with each command, which the loop executes once; `beat` counts heartbeats.
    """

    number: int
    kind: int
    beat: int
    a: float
    b: float
    c: float


class Report(NamedTuple):
    """The newest state of the arm, after `ticks` of its motion, at `arrival` [s] of the clock.

    Measured pose and velocity and commanded pose in the cell frame; `fx`, `fz` force on the gripper
    beyond its tare [N]; `off_plane` distance from the strip's plane [m]; `success` the robot's own
    rate of commands received in time; the rest are flags and the `number` of the last command
    taken.
    """

    ticks: int
    number: int
    arrival: float
    x: float
    z: float
    pitch: float
    vx: float
    vz: float
    pitch_rate: float
    x_commanded: float
    z_commanded: float
    pitch_commanded: float
    fx: float
    fz: float
    off_plane: float
    success: float
    moving: int
    expired: int


ORDER_LAYOUT = "=qqq3d"
REPORT_LAYOUT = "=qq14dqq"
