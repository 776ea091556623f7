"""Protocols that devices of the twin and of the hardware satisfy: clock, arm, hand, camera."""

from typing import Protocol

from drivers.types import ArmState, Frame, HandState, Pose, Velocity


class Clock(Protocol):
    """Monotonic clock of a run [s]; the only source of time and of waiting."""

    def now(self) -> float:
        """Seconds since the run began."""

    def wait_until(self, time: float) -> None:
        """Return when `time` has come; on the twin this, and only this, advances the world."""


class Arm(Protocol):
    """Interface of an arm: a gripper point that moves in the plane of the strip, in the cell frame.

    The arm's driver owns the 1 kHz servo. Methods return at once; `state().moving` says whether a
    motion is under way. Raises `Fault` when the robot refuses or has stopped by itself.
    """

    def connect(self) -> None:
        """Connect and hold the arm at rest."""

    def state(self) -> ArmState:
        """The newest measured state of the arm."""

    def move_to(self, pose: Pose) -> None:
        """Start a motion to rest at `pose` within the limits; a new command replaces it."""

    def set_velocity(self, velocity: Velocity) -> None:
        """Follow `velocity` from now on; without a new command the arm brakes after a timeout."""

    def stop(self) -> None:
        """Brake within the limits; allowed at any time, from any state."""

    def close(self) -> None:
        """Brake and disconnect; calling it twice is allowed."""


class Hand(Protocol):
    """Interface of a gripper with two fingers."""

    def open(self) -> None:
        """Start to open the fingers."""

    def grasp(self) -> None:
        """Start to close the fingers on the strip's edge."""

    def state(self) -> HandState:
        """The newest measured state of the fingers."""

    def stop(self) -> None:
        """Hold the fingers where they are."""


class Camera(Protocol):
    """Interface of a camera, which delivers stamped frames."""

    @property
    def rate(self) -> float:
        """Frames per second [Hz]: measured after `connect`, requested before it."""

    def connect(self) -> None:
        """Start delivering frames."""

    def read(self, after: float, timeout: float) -> Frame | None:
        """The newest frame that has arrived with a stamp later than `after`, or None.

        Waits at most `timeout` [s]; 0 only looks. On the twin it never steps the world, so any
        timeout there is 0: the caller waits on the clock.
        """

    def close(self) -> None:
        """Stop and release the device; calling it twice is allowed."""
