"""Installation of an arm in a cell: its mounting and workspace, and the limits of its
motion.
"""

from math import isfinite, pi
from typing import Annotated

from pydantic import AfterValidator, Field

from drivers.base.errors import Fault
from drivers.base.geometry import CellInRobot
from drivers.base.settings import Settings
from drivers.base.types import Pose, Velocity

AXIS_NAMES = ("x", "z", "pitch")
AXIS_UNITS = ("m", "m", "rad")


class AxisLimits(Settings):
    """Largest velocity, acceleration and jerk on one axis: [m/s, m/s^2, m/s^3], or in
    rad.

    Values are bounded above, so that no limit can be switched off by a large number.
    """

    velocity: float = Field(gt=0, le=3)
    acceleration: float = Field(gt=0, le=25)
    jerk: float = Field(gt=0, le=12500)

    def tighter(self, other: "AxisLimits") -> "AxisLimits":
        """Copy with the lower limits of this axis and of `other`."""
        limits = AxisLimits.model_fields
        return AxisLimits(
            **{name: min(getattr(self, name), getattr(other, name)) for name in limits}
        )


class MotionLimits(Settings):
    """Limits of the gripper's motion on its axes x, z and pitch.

    Pitch turns by pi/2 over 0.10 m of path, so its limits are those of x times that
    ratio, bounded by the robot's 2.6 rad/s; the lift then stays on its line.
    """

    x: AxisLimits = AxisLimits(velocity=0.2, acceleration=4.0, jerk=100.0)
    z: AxisLimits = AxisLimits(velocity=0.2, acceleration=4.0, jerk=100.0)
    pitch: AxisLimits = AxisLimits(velocity=2.6, acceleration=16.0, jerk=1500.0)

    @property
    def axes(self) -> tuple[AxisLimits, AxisLimits, AxisLimits]:
        """Motion limits of the axes x, z and pitch, in this order."""
        return self.x, self.z, self.pitch

    def tighter(self, other: "MotionLimits") -> "MotionLimits":
        """Copy with the lower limits of these and of `other`, axis by axis."""
        axes = (a.tighter(b) for a, b in zip(self.axes, other.axes, strict=True))
        return MotionLimits(**dict(zip(AXIS_NAMES, axes, strict=True)))

    def check(self, velocity: Velocity) -> None:
        """Raise Fault `velocity_refused` for a velocity that is not finite or above a
        limit.
        """
        for axis, unit, limits, rate in zip(
            AXIS_NAMES, AXIS_UNITS, self.axes, velocity, strict=True
        ):
            if not isfinite(rate) or abs(rate) > limits.velocity:
                raise Fault(
                    "velocity_refused",
                    f"{rate:g} {unit}/s on {axis} is over the limit; "
                    f"allowed: {limits.velocity:g} {unit}/s at most",
                )


def _order(span: tuple[float, float]) -> tuple[float, float]:
    if span[0] >= span[1]:
        raise ValueError(f"needs low < high, found [{span[0]:g}, {span[1]:g}]")
    return span


Along = Annotated[float, Field(ge=-3, le=3)]
Above = Annotated[float, Field(ge=-0.05, le=2)]
Turned = Annotated[float, Field(ge=-2 * pi, le=2 * pi)]


class Workspace(Settings):
    """Allowed gripper poses: [low, high] of x, z [m] and pitch [rad] in the cell
    frame.
    """

    x: Annotated[tuple[Along, Along], AfterValidator(_order)] = (-0.15, 0.85)
    z: Annotated[tuple[Above, Above], AfterValidator(_order)] = (-0.01, 0.5)
    pitch: Annotated[tuple[Turned, Turned], AfterValidator(_order)] = (-0.2, pi + 0.2)

    @property
    def low(self) -> tuple[float, float, float]:
        """Lowest allowed x, z [m] and pitch [rad]."""
        return self.x[0], self.z[0], self.pitch[0]

    @property
    def high(self) -> tuple[float, float, float]:
        """Highest allowed x, z [m] and pitch [rad]."""
        return self.x[1], self.z[1], self.pitch[1]

    def check(self, pose: Pose) -> None:
        """Raise Fault `outside_workspace` for a gripper pose that is not finite or not
        allowed.
        """
        for axis, unit, low, high, value in zip(
            AXIS_NAMES, AXIS_UNITS, self.low, self.high, pose, strict=True
        ):
            if not (isfinite(value) and low <= value <= high):
                raise Fault(
                    "outside_workspace",
                    f"{axis} = {value:g} {unit} is out of reach; "
                    f"allowed: {low:g} to {high:g} {unit}",
                )


class Mounting(Settings):
    """Pose of the cell frame in the robot's base: origin [m] and yaw of its x-axis
    [rad].

    By default the strip lies crosswise in front of the robot, centred, on a desk above
    the robot's base, so that the hand lies flat over both of its ends.
    """

    x: float = Field(0.36, ge=-2, le=2)
    y: float = Field(-0.3, ge=-2, le=2)
    z: float = Field(0.15, ge=-1, le=1)
    yaw: float = Field(pi / 2, ge=-pi, le=pi)

    def transform(self) -> CellInRobot:
        """Rigid transform from the cell frame to the robot's base."""
        return CellInRobot.from_yaw(self.x, self.y, self.z, self.yaw)


class Installation(Settings):
    """Mounting, motion limits and workspace of a cell's arm; `desk` is x [m] of the
    desk's end.

    The gripper's home is `home_height` [m] over the strip's free edge.
    """

    limits: MotionLimits = MotionLimits()
    workspace: Workspace = Workspace()
    mounting: Mounting = Mounting()
    home_height: float = Field(0.15, ge=0.02, le=0.5)
    desk: float | None = Field(None, gt=0, le=3, exclude_if=lambda end: end is None)
