"""Conversion between gripper poses in the strip's plane and hand poses in the robot's base."""

from dataclasses import dataclass
from math import atan2, cos, pi, sin

import numpy as np

from drivers.franka.inverse_kinematics import rotation, rotation_vector
from drivers.geometry import CellInRobot
from drivers.motion import TICK
from drivers.types import Array

Numbers = list[float]
Triple = tuple[float, float, float]
OUT_OF_PLANE = 0.005  # m, largest constant distance of a motion from the strip's plane
LEANING = 0.05  # rad, likewise its angle
FADE_TICKS = 100  # ticks until a hand that drifted is back in the plane
NO_OFFSET = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class PlaneMotion:
    """Motion of the hand split into the part in the strip's plane and the part off the plane.

    `pose` is x, z [m], pitch [rad]; `aside` is the offset across the plane [m] and the lean about
    x and z [rad]; both with first and second derivatives.
    """

    pose: Triple
    velocity: Triple
    acceleration: Triple
    aside: Numbers
    aside_velocity: Numbers
    aside_acceleration: Numbers


class StripPlane:
    """Transform between gripper poses in the cell frame and hand poses in the robot's base.

    The hand's approach axis lies in the plane: at pitch pi/2 it points down. `turned` rotates the
    hand by half a turn about that axis, an equivalent grasp that uses other wrist angles. All poses
    have the small offset from the plane that the hand had at `take_over`.
    """

    def __init__(self, cell_in_robot: CellInRobot, *, turned: bool = False) -> None:
        frame = cell_in_robot.matrix
        sign = -1.0 if turned else 1.0
        self._rows: list[Numbers] = np.linalg.inv(frame)[:3].tolist()
        self._along: Numbers = frame[:3, 0].tolist()
        self._across: Numbers = (-sign * frame[:3, 1]).tolist()
        self._up: Numbers = frame[:3, 2].tolist()
        self._origin: Numbers = frame[:3, 3].tolist()
        self._axes: Array = frame[:3, :3].T.copy()
        self._sign = sign
        self.turned = turned
        self._rest: Array | None = None
        self._back: Array | None = None  # its inverse

    def take_over(self, pose: Numbers) -> None:
        """Give all poses the hand's offset from the plane at its present `pose` (16,)."""
        rest = np.linalg.solve(self.matrix(*self.to_cell(pose)), matrix(pose))
        self._rest = np.asarray(rest, dtype=np.float64)
        self._back = np.asarray(np.linalg.inv(rest), dtype=np.float64)

    def command(self, x: float, z: float, pitch: float, aside: Triple = NO_OFFSET) -> Numbers:
        """Hand pose in the base, a column-major 4x4 matrix (16,), for x, z [m], pitch [rad].

        `aside` leaves the plane: an offset across it [m], angles [rad] about its x and z axes.
        """
        pose = self.matrix(x, z, pitch)
        if any(aside):
            pose[:3, 3] += aside[0] * self._axes[1]
            pose[:3, :3] = (
                rotation(aside[1] * self._axes[0] + aside[2] * self._axes[2]) @ (pose[:3, :3])
            )
        if self._rest is not None:
            pose = pose @ self._rest
        numbers: Numbers = pose.T.ravel().tolist()
        return numbers

    def split_motion(self, pose: Numbers, twist: Numbers, change: Numbers) -> PlaneMotion:
        """Split a motion of the hand in the base: `pose` (16,), `twist` and its `change` (6,)."""
        hand = matrix(pose)
        inside = hand if self._back is None else hand @ self._back
        spin, spin_change = _cross_matrix(twist[3:]), _cross_matrix(change[3:])
        lever = inside[:3, 3] - hand[:3, 3]
        linear = np.array(twist[:3]) + spin @ lever
        linear_change = np.array(change[:3]) + spin_change @ lever + spin @ (spin @ lever)
        columns: Numbers = inside.T.ravel().tolist()
        x, z, pitch = self.to_cell(columns)
        lean = rotation_vector(inside[:3, :3] @ self.matrix(x, z, pitch)[:3, :3].T)
        lean_x, _, lean_z = (self._axes @ lean).tolist()
        pose_aside = [self.place(columns)[1], lean_x, lean_z]
        velocity, velocity_aside = self._split_rates(linear, twist[3:])
        acceleration, acceleration_aside = self._split_rates(linear_change, change[3:])
        _correct_for_pitch(
            pose_aside, velocity_aside, acceleration_aside, velocity[2], acceleration[2]
        )
        return PlaneMotion(
            (x, z, pitch), velocity, acceleration,
            pose_aside, velocity_aside, acceleration_aside,
        )  # fmt: skip

    def _split_rates(self, linear: Array, angular: Numbers) -> tuple[Triple, Numbers]:
        """Split a twist into rates of x, z, pitch and rates off the plane: offset, two angles."""
        along, across, up = (self._axes @ linear).tolist()
        lean, turn, yaw = (self._axes @ np.array(angular)).tolist()
        return (along, up, -turn), [across, lean, yaw]

    def matrix(self, x: float, z: float, pitch: float) -> Array:
        """Hand pose (4, 4) in the robot's base, exactly in the plane, for x, z [m], pitch [rad]."""
        c, s = cos(pitch - pi / 2), sin(pitch - pi / 2)
        sign, axes = self._sign, (self._along, self._across, self._up, self._origin)
        pose = [
            (sign * (c * along + s * up), across, s * along - c * up, x * along + z * up + origin)
            for along, across, up, origin in zip(*axes, strict=True)
        ]
        return np.array([*pose, (0.0, 0.0, 0.0, 1.0)])

    def to_cell(self, pose: Numbers) -> tuple[float, float, float]:
        """x, z [m] and pitch [rad] in the cell of a hand pose in the base, column-major (16,)."""
        x, _, z = self.place(pose)
        along, up = (_dot(row, pose[8:11]) for row in (self._rows[0], self._rows[2]))
        return x, z, _pitch_of_axis(along, up)

    def place(self, pose: Numbers) -> tuple[float, float, float]:
        """x, y, z [m] in the cell of a hand pose in the base, column-major (16,)."""
        point = pose[12:15]
        x, y, z = (_dot(row, point) + row[3] for row in self._rows)
        return x, y, z

    def aside(self, pose: Numbers) -> tuple[float, float]:
        """Distance [m] and angle [rad] of a hand pose (16,) from its projection into the plane."""
        off = np.linalg.solve(self.matrix(*self.to_cell(pose)), matrix(pose))
        angle = float(np.arccos(np.clip((np.trace(off[:3, :3]) - 1) / 2, -1.0, 1.0)))
        return float(np.linalg.norm(off[:3, 3])), angle

    def force(self, wrench: Numbers) -> tuple[float, float]:
        """f_x, f_z [N] in the cell frame of a `wrench` (6,) [N, N m] in the robot's base."""
        return _dot(self._along, wrench), _dot(self._up, wrench)


class FadingOffset:
    """Offset of the hand across the strip's plane [m] and two angles [rad], which fade to zero.

    A robot without commands extrapolates its last ones, rounding errors included, and drifts out
    of the plane. Polynomials of fifth degree bring offset and angles from there to rest at zero.
    """

    def __init__(self) -> None:
        self._place: Numbers = list(NO_OFFSET)
        self._rate: Numbers = list(NO_OFFSET)
        self._change: Numbers = list(NO_OFFSET)
        self._age = FADE_TICKS

    def begin(self, place: Numbers, rate: Numbers, change: Numbers) -> None:
        """Fade from `place` (3,) [m, rad, rad] with its derivatives `rate` and `change` (3,)."""
        self._place, self._rate, self._change = place, rate, change
        self._age = 0

    def tick(self) -> tuple[float, float, float]:
        """Advance by one tick; returns offset and angles (3,) [m, rad, rad] at its end."""
        if self._age >= FADE_TICKS:
            return NO_OFFSET
        self._age += 1
        share, duration = self._age / FADE_TICKS, FADE_TICKS * TICK
        left = (1.0 - share) ** 3
        weights = (
            left * (1.0 + 3.0 * share + 6.0 * share**2),
            left * share * (1.0 + 3.0 * share) * duration,
            left * share**2 * duration**2 / 2.0,
        )
        offset, about_x, about_z = (
            sum(w * part for w, part in zip(weights, parts, strict=True))
            for parts in zip(self._place, self._rate, self._change, strict=True)
        )
        return offset, about_x, about_z


def _correct_for_pitch(
    place: Numbers, rate: Numbers, change: Numbers, pitch_rate: float, pitch_change: float
) -> None:
    """Convert the derivatives of the two lean angles to axes that pitch with the hand.

    Corrects `rate` and `change` in place, to first order in the angles `place`.
    """
    rate[1] -= place[2] * pitch_rate
    rate[2] += place[1] * pitch_rate
    change[1] -= rate[2] * pitch_rate + place[2] * pitch_change
    change[2] += rate[1] * pitch_rate + place[1] * pitch_change


def _pitch_of_axis(along: float, up: float) -> float:
    """Pitch [rad] of an approach axis with components `along` x and `up`: -x is 0, down is pi/2."""
    pitch = atan2(-up, -along)
    return pitch + 2 * pi if pitch < -pi / 2 else pitch


def _cross_matrix(vector: Numbers) -> Array:
    """Skew-symmetric matrix (3, 3) of the cross product with `vector`."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _dot(a: Numbers, b: Numbers) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def matrix(columns: Numbers) -> Array:
    """Pose (4, 4) from its 16 numbers in column-major order."""
    return np.array(columns).reshape(4, 4).T
