"""Values that drivers and cell exchange: poses, velocities, device states, frames."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Image = NDArray[np.uint8]
Arguments = Sequence[tuple[Any, ...]]
# calls a function with each of the arguments, somewhere; yields numbers and results as
# calls end
Calls = Callable[[Callable[..., Any], Arguments], Iterator[tuple[int, Any]]]
GRAVITY = 9.81  # m/s^2


@dataclass(frozen=True, slots=True)
class Pose:
    """Gripper pose in the cell frame: x, z [m], pitch of the strip's end tangent [rad].

    Pitch is 0 with the end flat along +x and pi/2 with the strip hanging straight down.
    """

    x: float
    z: float
    pitch: float

    def __iter__(self) -> Iterator[float]:
        """Yield x, z [m] and pitch [rad]."""
        return iter((self.x, self.z, self.pitch))

    @classmethod
    def from_array(cls, values: Array) -> Self:
        """Pose of the x, z [m] and pitch [rad] in `values` (3,)."""
        return cls(*values.tolist())

    def as_array(self) -> Array:
        """Pose as an array (3,) of x, z [m] and pitch [rad]."""
        return np.array([*self])


@dataclass(frozen=True, slots=True)
class Velocity:
    """Velocity of the gripper in the cell frame: vx, vz [m/s], pitch_rate [rad/s]."""

    vx: float
    vz: float
    pitch_rate: float

    def __iter__(self) -> Iterator[float]:
        """Yield vx, vz [m/s] and pitch_rate [rad/s]."""
        return iter((self.vx, self.vz, self.pitch_rate))

    @property
    def speed(self) -> float:
        """Speed of the gripper point [m/s]."""
        return float(np.hypot(self.vx, self.vz))


ZERO_VELOCITY = Velocity(0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Reading:
    """Header of every measurement: times `stamp`, `arrival` [s] since the run's start,
    source.
    """

    stamp: float
    arrival: float
    source: str


@dataclass(frozen=True, slots=True)
class ArmState(Reading):
    """Measured `pose` and `velocity` of the arm, and the pose `commanded` by its servo.

    `moving` is true while the arm is in motion; `expired` once a velocity command timed
    out and the arm braked. `force` on the gripper is (f_x, f_z) [N], NaN where not
    measured.
    """

    pose: Pose
    velocity: Velocity
    commanded: Pose
    moving: bool
    expired: bool
    force: tuple[float, float] = (float("nan"), float("nan"))


@dataclass(frozen=True, slots=True)
class HandState(Reading):
    """Measured state of the hand: finger `width` [m], whether it holds something or
    moves.
    """

    width: float
    grasped: bool
    moving: bool


@dataclass(frozen=True, slots=True)
class Frame(Reading):
    """Camera image (height, width, 3) BGR; `stamp` is the middle of its exposure
    [s].
    """

    sequence: int
    image: Image

    def restamp(self, offset: float) -> Self:
        """Copy of this frame with its stamp moved by `offset` [s]."""
        return replace(self, stamp=self.stamp + offset)


def frozen(values: object) -> Array:
    """Read-only float64 copy of `values`, of the same shape."""
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array


@dataclass(frozen=True, slots=True)
class BoardPlacement:
    """Pose of a board in front of the camera, described by its position and size in the
    image.

    `x`, `y` are the centre as fractions of the image, `size` the board's width as a
    fraction of the image's. At zero angles [rad] it faces the camera; `tilt` leans its
    top away, `turn` moves its right edge away, `roll` turns it clockwise.
    """

    x: float
    y: float
    size: float
    tilt: float = 0.0
    turn: float = 0.0
    roll: float = 0.0
