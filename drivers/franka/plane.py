"""Conversion between gripper poses in the strip's plane and hand poses in the robot's
base.
"""

from math import atan2, pi
from typing import NamedTuple

import numpy as np

from drivers.base.geometry import CellInRobot
from drivers.base.motion import TICK
from drivers.base.types import Array
from drivers.franka.inverse_kinematics import rotation, rotation_vector
from drivers.franka.kinematics import pose_from_columns

Numbers = list[float]
Triple = tuple[float, float, float]
OUT_OF_PLANE = 0.005  # m, largest constant distance of a motion from the strip's plane
LEANING = 0.05  # rad, likewise its angle
FADE_TICKS = 100  # ticks until a hand that drifted is back in the plane
NO_OFFSET = (0.0, 0.0, 0.0)


class Coordinates(NamedTuple):
    """Three coordinates [m or rad] at one time, with first and second derivatives by
    time [s].
    """

    value: Triple
    rate: Triple
    change: Triple


class SplitMotion(NamedTuple):
    """Motion of the hand split into the part in the strip's plane and the part off the
    plane.

    `inside` is x, z [m], pitch [rad]; `aside` is the offset across the plane [m] and
    the lean about x and z [rad].
    """

    inside: Coordinates
    aside: Coordinates


class StripPlane:
    """Transform between gripper poses in the cell frame and hand poses in the robot's
    base.

    The hand's approach axis lies in the plane: at pitch pi/2 it points down. So does
    the axis y along which its fingers open, normal to the grasped edge: they pinch the
    strip's thickness. `turned` rotates the hand by half a turn about the approach axis,
    an equivalent grasp that uses other wrist angles.
    """

    def __init__(
        self,
        cell_in_robot: CellInRobot,
        *,
        turned: bool = False,
        rest: Array | None = None,
    ) -> None:
        """Use the plane y = 0 of the cell; all hand poses keep the offset `rest` (4, 4)
        from it.
        """
        frame = cell_in_robot.matrix
        self._cell_in_robot = cell_in_robot
        self._rows: list[Numbers] = np.linalg.inv(frame)[:3].tolist()
        self._along: Numbers = frame[:3, 0].tolist()
        self._up: Numbers = frame[:3, 2].tolist()
        self._axes: Array = frame[:3, :3].T.copy()
        self.turned = turned
        self._rest = np.eye(4) if rest is None else rest
        self._back = np.asarray(np.linalg.inv(self._rest), dtype=np.float64)

    def with_offset_of(self, pose: Numbers) -> "StripPlane":
        """Copy whose poses all have the offset from the plane of the hand at `pose`
        (16,).
        """
        return StripPlane(
            self._cell_in_robot, turned=self.turned, rest=self._offset(pose)
        )

    def command(
        self, x: float, z: float, pitch: float, aside: Triple = NO_OFFSET
    ) -> Numbers:
        """Hand pose in the base, a column-major 4x4 matrix (16,), for x, z [m], pitch
        [rad].

        `aside` leaves the plane: an offset across it [m], angles [rad] about its x and
        z axes.
        """
        pose = self.matrix(x, z, pitch)
        if any(aside):
            pose[:3, 3] += aside[0] * self._axes[1]
            lean = rotation(aside[1] * self._axes[0] + aside[2] * self._axes[2])
            pose[:3, :3] = lean @ pose[:3, :3]
        numbers: Numbers = (pose @ self._rest).T.ravel().tolist()
        return numbers

    def split_motion(
        self, pose: Numbers, twist: Numbers, acceleration: Numbers
    ) -> SplitMotion:
        """Split a motion of the hand in the base into the parts in the plane and off
        the plane.

        `pose` (16,) is a column-major 4x4 matrix, `twist` (6,) [m/s, rad/s] and
        `acceleration` (6,) are its derivatives.
        """
        hand = pose_from_columns(pose)
        gripper = hand @ self._back
        lever = gripper[:3, 3] - hand[:3, 3]
        velocity, linear_acceleration = _motion_of_point(lever, twist, acceleration)
        rate, rate_aside = self._split_rates(velocity, twist[3:])
        change, change_aside = self._split_rates(linear_acceleration, acceleration[3:])
        columns: Numbers = gripper.T.ravel().tolist()
        inside = Coordinates(self.to_cell(columns), rate, change)
        lean = rotation_vector(gripper[:3, :3] @ self.matrix(*inside.value)[:3, :3].T)
        lean_x, _, lean_z = (self._axes @ lean).tolist()
        offset = self.position_in_cell(columns)[1]
        aside = Coordinates((offset, lean_x, lean_z), rate_aside, change_aside)
        return SplitMotion(inside, _in_pitching_axes(aside, inside))

    def _split_rates(self, linear: Array, angular: Numbers) -> tuple[Triple, Triple]:
        """Split a twist [m/s, rad/s] into rates of x, z, pitch, and of offset and
        angles aside.
        """
        along, across, up = (self._axes @ linear).tolist()
        lean, turn, yaw = (self._axes @ np.array(angular)).tolist()
        return (along, up, -turn), (across, lean, yaw)

    def matrix(self, x: float, z: float, pitch: float) -> Array:
        """Hand pose (4, 4) in the robot's base, exactly in the plane, for x, z [m],
        pitch [rad].
        """
        return self._cell_in_robot.to_robot(x, z, pitch, turned=self.turned)

    def to_cell(self, pose: Numbers) -> Triple:
        """x, z [m] and pitch [rad] in the cell of a hand pose in the base, column-major
        (16,).
        """
        x, _, z = self.position_in_cell(pose)
        approach = pose[8:11]  # axis of the hand: along -x at pitch 0, down at pi/2
        pitch = atan2(-_dot(self._rows[2], approach), -_dot(self._rows[0], approach))
        return x, z, pitch + 2 * pi if pitch < -pi / 2 else pitch

    def position_in_cell(self, pose: Numbers) -> Triple:
        """x, y, z [m] in the cell of a hand pose in the base, column-major (16,)."""
        point = pose[12:15]
        x, y, z = (_dot(row, point) + row[3] for row in self._rows)
        return x, y, z

    def aside(self, pose: Numbers) -> tuple[float, float]:
        """Distance [m] and angle [rad] of a hand pose (16,) from its projection into
        the plane.
        """
        off = self._offset(pose)
        angle = float(np.arccos(np.clip((np.trace(off[:3, :3]) - 1) / 2, -1.0, 1.0)))
        return float(np.linalg.norm(off[:3, 3])), angle

    def _offset(self, pose: Numbers) -> Array:
        """Pose (4, 4) [m] of a hand at `pose` (16,) relative to its projection into the
        plane.
        """
        off = np.linalg.solve(self.matrix(*self.to_cell(pose)), pose_from_columns(pose))
        return np.asarray(off, dtype=np.float64)

    def force(self, wrench: Numbers) -> tuple[float, float]:
        """f_x, f_z [N] in the cell frame of a `wrench` (6,) [N, N m] in the robot's
        base.
        """
        return _dot(self._along, wrench), _dot(self._up, wrench)


class FadingOffset:
    """Offset of the hand across the strip's plane [m] and two angles [rad], which fade
    to zero.

    A robot without commands extrapolates its last ones, rounding errors included, and
    drifts out of the plane. Polynomials of fifth degree bring offset and angles from
    there to rest at zero.
    """

    def __init__(self) -> None:
        self._start = Coordinates(NO_OFFSET, NO_OFFSET, NO_OFFSET)
        self._age = FADE_TICKS

    def begin(self, start: Coordinates) -> None:
        """Begin to fade from the offset and two angles of `start` [m, rad, rad]."""
        self._start = start
        self._age = 0

    def tick(self) -> Triple:
        """Advance by one tick; returns offset and angles (3,) [m, rad, rad] at its
        end.
        """
        if self._age >= FADE_TICKS:
            return NO_OFFSET
        self._age += 1
        share = self._age / FADE_TICKS
        duration = FADE_TICKS * TICK
        remaining = (1.0 - share) ** 3
        weights = (
            remaining * (1.0 + 3.0 * share + 6.0 * share**2),
            remaining * share * (1.0 + 3.0 * share) * duration,
            remaining * share**2 * duration**2 / 2.0,
        )
        offset, about_x, about_z = np.dot(weights, self._start).tolist()
        return offset, about_x, about_z


def _motion_of_point(
    lever: Array, twist: Numbers, acceleration: Numbers
) -> tuple[Array, Array]:
    """Velocity and acceleration (3,) of a point at `lever` (3,) [m] from `twist` (6,)
    of a body.

    `acceleration` (6,) is the twist's derivative.
    """
    swing = np.cross(twist[3:], lever)
    change = np.cross(acceleration[3:], lever) + np.cross(twist[3:], swing)
    return twist[:3] + swing, acceleration[:3] + change


def _in_pitching_axes(aside: Coordinates, inside: Coordinates) -> Coordinates:
    """Motion `aside` with its rates of small leans about axes that turn with the pitch
    `inside`.
    """
    pitch_rate = inside.rate[2]
    pitch_change = inside.change[2]
    _, lean_x, lean_z = aside.value
    across, rate_x, rate_z = aside.rate
    across_change, change_x, change_z = aside.change
    rate_x -= lean_z * pitch_rate
    rate_z += lean_x * pitch_rate
    change_x -= rate_z * pitch_rate + lean_z * pitch_change
    change_z += rate_x * pitch_rate + lean_x * pitch_change
    return Coordinates(
        aside.value, (across, rate_x, rate_z), (across_change, change_x, change_z)
    )


def _dot(a: Numbers, b: Numbers) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
