"""Limits at which monitors stop a run."""

from pydantic import Field

from drivers.settings import Settings


class MonitorLimits(Settings):
    """Limits of the monitors, each with a value; none can be switched off."""

    arm_age: float = Field(0.05, gt=0, le=0.5)  # s
    hand_age: float = Field(0.5, gt=0, le=2.0)  # s
    image_age: float = Field(0.25, gt=0, le=1.0)  # s, from which on the arm stands and waits
    image_wait: float = Field(0.15, gt=0, le=1.0)  # s that it waits for a younger image
    reading: float = Field(0.25, gt=0, le=1.0)  # s beside the loop, of one image
    identical_images: int = Field(3, ge=2, le=30)  # one that a camera sends twice is none
    confidence: float = Field(0.3, gt=0, lt=1)
    doubt: float = Field(0.4, gt=0, le=2.0)  # s of low confidence before the arm stops
    camera_shift: float = Field(0.001, gt=0, le=0.01)  # m by which the scene may seem moved
    overspeed: float = Field(1.25, ge=1.0, le=2.0)  # measured over allowed speed
    speed: float = Field(0.25, gt=0, le=1.0)  # m/s
    tracking_error: float = Field(0.015, gt=0, le=0.1)  # m, measured from commanded
    border: float = Field(0.005, gt=0, le=0.02)  # m that a measured pose may lie out of the box
    force: float = Field(20.0, gt=0, le=60.0)  # N on the gripper
    duration: float = Field(120.0, gt=0, le=900.0)  # s of a whole run
    state_duration: float = Field(60.0, gt=0, le=300.0)  # s in one state
    turn: float = Field(300.0, gt=0, le=3600)  # s of one turn in lock-step; 1 s on the wall clock
    calibration: float = Field(1800.0, gt=0, le=14400.0)  # s of CALIBRATE, which waits for people
