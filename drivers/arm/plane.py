"""The plane of the strip in the robot's frame, and poses of the hand in it."""

from math import atan2, cos, pi, sin

import numpy as np

from drivers.geometry import CellInRobot
from drivers.types import Array

Numbers = list[float]
BESIDE = 0.005  # m beside the strip's plane that are taken along
LEANING = 0.05  # rad out of it, likewise


class StripPlane:
    """Transform between gripper poses in the cell frame and hand poses in the robot's base.

    The hand's approach axis lies in the plane: at pitch pi/2 it points down. `turned` rotates the
    hand by half a turn about that axis, an equivalent grasp that uses other wrist angles. The small
    offset from the plane at `take_over` is kept.
    """

    def __init__(self, cell_in_robot: CellInRobot, *, turned: bool = False) -> None:
        frame = cell_in_robot.matrix
        sign = -1.0 if turned else 1.0
        self._rows: list[Numbers] = np.linalg.inv(frame)[:3].tolist()
        self._along: Numbers = frame[:3, 0].tolist()
        self._across: Numbers = (-sign * frame[:3, 1]).tolist()
        self._up: Numbers = frame[:3, 2].tolist()
        self._origin: Numbers = frame[:3, 3].tolist()
        self._sign = sign
        self.turned = turned
        self._rest: Array | None = None

    def take_over(self, pose: Numbers) -> None:
        """Keep the offset of `pose` from the plane, so that the first command equals it."""
        rest = np.linalg.solve(self.matrix(*self.to_cell(pose)), matrix(pose))
        self._rest = np.asarray(rest, dtype=np.float64)

    def command(self, x: float, z: float, pitch: float) -> Numbers:
        """The hand's pose in the base as 16 numbers, column-major, as the robot takes it."""
        pose = self.matrix(x, z, pitch)
        if self._rest is not None:
            pose = pose @ self._rest
        numbers: Numbers = pose.T.ravel().tolist()
        return numbers

    def commanded(self, pose: Numbers) -> tuple[float, float, float]:
        """x, z [m] and pitch [rad] whose `command` is `pose`."""
        if self._rest is None:
            return self.to_cell(pose)
        inside = matrix(pose) @ np.linalg.inv(self._rest)
        return self.to_cell(inside.T.ravel().tolist())

    def rates(self, twist: Numbers) -> tuple[float, float, float]:
        """Rates of x, z and pitch of a twist (6,) of the hand in the base, or of its derivative."""
        turn = _dot(self._across, twist[3:])
        return _dot(self._along, twist), _dot(self._up, twist), self._sign * turn

    def matrix(self, x: float, z: float, pitch: float) -> Array:
        """The hand's pose (4, 4) in the base, exactly in the plane."""
        c, s = cos(pitch - pi / 2), sin(pitch - pi / 2)
        across, sign = self._across, self._sign
        rows = zip(self._along, across, self._up, self._origin, strict=True)
        pose = [
            (sign * (c * e + s * u), a, s * e - c * u, x * e + z * u + o) for e, a, u, o in rows
        ]
        return np.array([*pose, (0.0, 0.0, 0.0, 1.0)])

    def to_cell(self, pose: Numbers) -> tuple[float, float, float]:
        """x, z [m] and pitch [rad] of a hand's pose in the base, 16 numbers, column-major."""
        x, _, z = self.place(pose)
        along, up = (_dot(row, pose[8:11]) for row in (self._rows[0], self._rows[2]))
        return x, z, _pitch(along, up)

    def place(self, pose: Numbers) -> tuple[float, float, float]:
        """x, y, z [m] in the cell frame of a hand's pose, 16 numbers, column-major."""
        point = pose[12:15]
        x, y, z = (_dot(row, point) + row[3] for row in self._rows)
        return x, y, z

    def aside(self, pose: Numbers) -> tuple[float, float]:
        """Distance from the plane [m] and angle out of it [rad] of a hand's pose."""
        off = np.linalg.solve(self.matrix(*self.to_cell(pose)), matrix(pose))
        angle = float(np.arccos(np.clip((np.trace(off[:3, :3]) - 1) / 2, -1.0, 1.0)))
        return float(np.linalg.norm(off[:3, 3])), angle

    def force(self, wrench: Numbers) -> tuple[float, float]:
        """f_x, f_z [N] in the cell frame of a wrench (6,) in the base."""
        return _dot(self._along, wrench), _dot(self._up, wrench)


def _pitch(along: float, up: float) -> float:
    """Pitch of an approach axis with these components in the cell: -x is 0, down pi/2, +x pi."""
    pitch = atan2(-up, -along)
    return pitch + 2 * pi if pitch < -pi / 2 else pitch


def _dot(a: Numbers, b: Numbers) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def matrix(columns: Numbers) -> Array:
    """Pose (4, 4) from 16 numbers, column-major."""
    return np.array(columns).reshape(4, 4).T
