"""Settings of a Franka arm and its hand."""

from typing import Annotated, Literal

from pydantic import Field

from drivers.base.installation import AxisLimits, Installation, MotionLimits
from drivers.base.settings import Settings
from drivers.franka.limits import Revision
from drivers.franka.model import HAND_CENTRE, HAND_MASS

RealTime = Literal["enforce", "priority", "ignore"]
Force = Annotated[float, Field(gt=0, le=100)]
PRESSED = 0.5  # of a thickness that calipers measured: the fingers press harder
HEM_LAYERS = 2.0
LOOSENESS = 0.001  # m by which a fabric is thicker than measured
Length = Annotated[float, Field(ge=-0.5, le=0.5)]


class CollisionSettings(Settings):
    """Thresholds of the robot's reflexes: contact is reported at `lower`, motion stops
    at `upper`.

    Torques [N m] hold for each joint, forces [N] for each axis, moments [N m] about
    each.
    """

    torque_lower: float = Field(20.0, gt=0, le=87)
    torque_upper: float = Field(30.0, gt=0, le=87)
    force_lower: Force = 20.0
    force_upper: Force = 30.0
    moment_lower: float = Field(15.0, gt=0, le=100)
    moment_upper: float = Field(25.0, gt=0, le=100)


class ToolSettings(Settings):
    """Mass properties of the Franka Hand as set in Desk: `mass` [kg], `centre` of mass
    [m].

    `centre` is in the flange's frame. No load is set: a strip weighs less than the
    force error.
    """

    mass: float = Field(HAND_MASS, gt=0, le=3)
    centre: tuple[Length, Length, Length] = HAND_CENTRE


class HandLimits(Settings):
    """Settings of the Franka Hand: widths [m], speed [m/s], grasp force [N].

    A strip counts as held from `thinnest` to `thickest`. The maker states that a grasp
    applies at least 30 N (libfranka#111).
    """

    opening: float = Field(0.04, ge=0.01, le=0.08)
    speed: float = Field(0.08, gt=0, le=0.1)
    force: float = Field(30.0, ge=30, le=70)
    thinnest: float = Field(0.0001, ge=0.0001, le=0.01)
    thickest: float = Field(0.006, ge=0.0005, le=0.02)

    def for_thickness(self, low: float, high: float) -> "HandLimits":
        """Copy narrowed to a fabric measured to be `low` to `high` [m] thick."""
        thickest = min(self.thickest, HEM_LAYERS * high + LOOSENESS)
        thinnest = min(max(self.thinnest, PRESSED * low), thickest)
        return self.model_copy(update={"thinnest": thinnest, "thickest": thickest})


REACHABLE = MotionLimits(
    x=AxisLimits(velocity=0.2, acceleration=0.8, jerk=100.0),
    z=AxisLimits(velocity=0.2, acceleration=0.8, jerk=100.0),
    pitch=AxisLimits(velocity=2.5, acceleration=4.0, jerk=1000.0),
)


class FciSettings(Settings):
    """Address and control settings of a Franka robot; times [s].

    Without an `address` the cell starts a twin that speaks the robot's protocol, in
    `lock_step`; with one, only a twin that was started in lock-step can be driven so.
    With `ask` a twin at an address counts as a physical robot: its motions are slow,
    and ask first.
    Plans without a robot have the published limits of `model`; with one, its own.
    `realtime` enforce requires a real-time kernel, as the manufacturer does; priority
    only that the user may have real-time priority, which the process that owns the loop
    takes; ignore neither. The arm brakes at `guard` [N] on the gripper and at
    `guard_torque` [N m] at a joint, before the robot's own reflex: beyond what it felt
    at rest before the motion, at most `rest` [N]. Where it rests again, it may feel
    `drift` [N]. `limits` hold where they are lower than the cell's: the joints
    accelerate at 10 rad/s^2 at most, which bounds the gripper most where the arm is
    stretched.
    """

    address: str | None = Field(None, pattern=r"^[A-Za-z0-9.:-]+$")
    lock_step: bool | None = None
    ask: bool = False
    model: Revision = "fr3"
    realtime: RealTime = "enforce"
    guard: Force = 15.0
    guard_torque: float = Field(15.0, gt=0, le=87)
    rest: Force = 10.0
    drift: Force = 8.0
    limits: MotionLimits = REACHABLE
    # of the cell, after which the arm brakes
    silence: float = Field(0.25, ge=0.1, le=1.0)
    # of the robot, after which it is given up
    answer: float = Field(1.6, ge=1.2, le=1.8)
    start: float = Field(30.0, ge=2.0, le=60.0)  # to connect, all in all
    collision: CollisionSettings = CollisionSettings()
    hand: HandLimits = HandLimits()
    tool: ToolSettings = ToolSettings()

    @property
    def in_lock_step(self) -> bool:
        """Whether the cell's clock drives the robot's time; possible with a twin
        only.
        """
        return self.address is None if self.lock_step is None else self.lock_step

    @property
    def scheduling(self) -> RealTime:
        """Real-time scheduling of what drives the robot, which waits in lock-step."""
        return "ignore" if self.in_lock_step else self.realtime

    def limit(self, installation: Installation) -> Installation:
        """Copy of `installation` whose motion limits are at most those of this
        robot.
        """
        limits = installation.limits.tighter(self.limits)
        return installation.model_copy(update={"limits": limits})
