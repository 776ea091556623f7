"""Conversion between gripper poses in the strip's plane and hand poses in the robot's
base.
"""

from math import atan2, pi

import numpy as np

from drivers.base.geometry import EDGE_AHEAD, CellInRobot
from drivers.base.types import Array
from drivers.franka.kinematics import pose_from_columns

Numbers = list[float]
Triple = tuple[float, float, float]
OUT_OF_PLANE = 0.005  # m, largest constant distance of a motion from the strip's plane
LEANING = 0.05  # rad, likewise its angle


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
        offset: Array | None = None,
    ) -> None:
        """Use the plane y = 0 of the cell; all hand poses keep `offset` (4, 4) from
        it.
        """
        frame = cell_in_robot.matrix
        self._cell_in_robot = cell_in_robot
        self._rows: list[Numbers] = np.linalg.inv(frame)[:3].tolist()
        self._along: Numbers = frame[:3, 0].tolist()
        self._up: Numbers = frame[:3, 2].tolist()
        self.turned = turned
        self._hand_offset = np.eye(4) if offset is None else offset

    def with_offset_of(self, pose: Numbers) -> "StripPlane":
        """Copy of the plane's transform whose hand poses all keep the offset that the
        hand at `pose` (16,) has from the plane.
        """
        return StripPlane(
            self._cell_in_robot, turned=self.turned, offset=self._offset(pose)
        )

    def command(self, x: float, z: float, pitch: float) -> Array:
        """Hand pose (4, 4) in the robot's base for a gripper at x, z [m] and pitch
        [rad], with the hand's offset.
        """
        return self.matrix(x, z, pitch) @ self._hand_offset

    def matrix(self, x: float, z: float, pitch: float) -> Array:
        """Hand pose (4, 4) in the robot's base, exactly in the plane, for x, z [m],
        pitch [rad].
        """
        return self._cell_in_robot.to_robot(x, z, pitch, turned=self.turned)

    def to_cell(self, pose: Numbers) -> Triple:
        """Gripper's x, z [m] and pitch [rad] in the cell for a hand pose in the robot's
        base, column-major (16,).
        """
        x, _, z = self.position_in_cell(pose)
        approach = pose[8:11]  # axis of the hand: along -x at pitch 0, down at pi/2
        along = _dot(self._rows[0], approach)
        up = _dot(self._rows[2], approach)
        pitch = atan2(-up, -along)
        whole = pitch + 2 * pi if pitch < -pi / 2 else pitch
        return x + EDGE_AHEAD * along, z + EDGE_AHEAD * up, whole

    def position_in_cell(self, pose: Numbers) -> Triple:
        """x, y, z [m] in the cell of a hand pose in the base, column-major (16,)."""
        point = pose[12:15]
        x, y, z = (_dot(row, point) + row[3] for row in self._rows)
        return x, y, z

    def aside(self, pose: Numbers) -> tuple[float, float]:
        """Distance [m] and angle [rad] of a hand pose (16,) from its projection into
        the strip's plane.
        """
        off = self._offset(pose)
        angle = float(np.arccos(np.clip((np.trace(off[:3, :3]) - 1) / 2, -1.0, 1.0)))
        return float(np.linalg.norm(off[:3, 3])), angle

    def _offset(self, pose: Numbers) -> Array:
        """Pose (4, 4) [m] of a hand at `pose` (16,) relative to its projection into the
        strip's plane.
        """
        projected = self.matrix(*self.to_cell(pose))
        return np.asarray(np.linalg.solve(projected, pose_from_columns(pose)))

    def force(self, wrench: Numbers) -> tuple[float, float]:
        """f_x, f_z [N] in the cell frame of a `wrench` (6,) [N, N m] in the robot's
        base.
        """
        return _dot(self._along, wrench), _dot(self._up, wrench)


def _dot(a: Numbers, b: Numbers) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
