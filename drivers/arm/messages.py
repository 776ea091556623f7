"""What passes between the cell and the process that owns the robot's 1 kHz loop."""

from enum import IntEnum
from typing import NamedTuple


class Kind(IntEnum):
    """What an order asks for."""

    HOLD = 0
    FOLLOW = 1
    MOVE = 2


class Order(NamedTuple):
    """The newest order: `a`, `b`, `c` are a velocity or a pose; `beat` rises while the cell lives.

    `number` rises with each order; the loop acts once on each.
    """

    number: int
    kind: int
    beat: int
    a: float
    b: float
    c: float


class Report(NamedTuple):
    """The newest state: after `ticks` of the motion, at `arrival` [s] of the shared clock.

    Pose and velocity measured and pose commanded in the cell frame; `fx`, `fz` the force on the
    gripper [N]; `off_plane` how far it stands beside the strip's plane [m]; `success` the robot's
    own share of commands in time; the rest are truth values and the `number` of the order taken.
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
