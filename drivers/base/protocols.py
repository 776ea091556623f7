"""Protocols of the cell's devices, simulated or real: clock, arm, hand, camera."""

from collections.abc import Mapping
from typing import Protocol

from drivers.base.types import ArmState, Frame, HandState, Pose, Velocity


class Clock(Protocol):
    """Protocol of a run's clock [s], the only source of time and of waiting."""

    def now(self) -> float:
        """Time [s] since the run began."""

    def wait_until(self, time: float) -> None:
        """Wait until the clock is at `time` [s]; on the twin only this advances the
        simulation.
        """


class Arm(Protocol):
    """Protocol of an arm, whose gripper point moves in the plane of the strip, in the
    cell frame.

    The driver runs the 1 kHz servo. Methods return at once; `state().moving` says
    whether the arm is in motion. Raises `Fault` when the robot refuses a command or has
    stopped by itself.
    """

    def connect(self) -> None:
        """Connect to the arm and hold it at rest."""

    def state(self) -> ArmState:
        """Newest measured state of the arm."""

    def move_to(self, pose: Pose) -> None:
        """Start a motion to rest at `pose` within the limits; a new command replaces
        it.
        """

    def set_velocity(self, velocity: Velocity) -> None:
        """Move at `velocity` from now on; without a new command the arm brakes after a
        timeout.
        """

    def stop(self) -> None:
        """Brake the arm within its limits; allowed at any time."""

    def close(self) -> None:
        """Brake the arm and disconnect from it; allowed twice."""


class Hand(Protocol):
    """Protocol of a gripper with two fingers; methods return at once."""

    def open(self, width: float | None = None) -> None:
        """Start to open the fingers, to `width` [m] or as wide as they go."""

    def grasp(self) -> None:
        """Start to close the fingers on the strip's edge."""

    def state(self) -> HandState:
        """Newest measured state of the fingers."""

    def stop(self) -> None:
        """Stop the fingers' motion; an object that they hold stays held."""


class Camera(Protocol):
    """Protocol of a camera that delivers stamped frames."""

    @property
    def rate(self) -> float:
        """Frame rate [Hz] that the device accepted or, before `connect`, that is
        requested.
        """

    def connect(self) -> None:
        """Connect to the camera and start its stream."""

    def read(self, after: float, timeout: float) -> Frame | None:
        """Newest frame with a stamp later than `after` [s]; None if none comes in
        `timeout` [s].

        The twin ignores `timeout`, because its simulation advances only on the clock.
        """

    def close(self) -> None:
        """Stop the stream and release the camera; allowed twice."""


class RealCamera(Camera, Protocol):
    """Protocol of a camera that is no part of the twin; a calibration is for its
    `identity`.
    """

    identity: str

    @property
    def locks(self) -> Mapping[str, int]:
        """Values to which its controls are locked, by name."""
