"""The maker's model of the arm with its hand over desk, clamp and strip, in MuJoCo.

The model is read from the package of others that carries it; nothing of it is ours.
"""

from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np

from drivers.franka.collision import Solids
from drivers.strip.file import StripFile
from drivers.types import Array

NEAR = 0.003  # m of the strip's edge from the middle between the pads
UPRIGHT = np.radians(3.0)  # of the pads' normal against that of the strip
PAD = 0.0085  # m, half of a pad along and across the fingers
ROBOT, AROUND = 1, 2  # bits of what may touch
FINGERS = ("left_finger", "right_finger")
ARM_JOINTS = [f"fr3_joint{number}" for number in range(1, 8)]
FINGER_JOINTS = ("finger_joint1", "finger_joint2")


class MakerScene:
    """Arm, hand, `solids` and a strip of `pieces` boxes, moved without dynamics."""

    def __init__(
        self, path: Path, solids: Solids, strip: StripFile, pieces: int
    ) -> None:
        spec = mujoco.MjSpec.from_file(str(path))
        spec.meshdir = str(path.parent / "meshes")
        for geom in spec.geoms:
            solid = geom.classname.name.startswith(("collision", "fingertip"))
            geom.contype, geom.conaffinity = (ROBOT, ROBOT | AROUND) if solid else (0, 0)
        _add_boxes(spec.worldbody, solids)
        for number in range(pieces):
            body = spec.worldbody.add_body(name=f"strip_{number}", mocap=True)
            size = [strip.length / pieces / 2, strip.width / 2, strip.thickness / 2]
            _add_box(body, f"strip_{number}", size, colour=(0.2, 0.35, 0.8, 1.0))
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self._frame = solids.frame
        self._joints = [self.model.joint(name).qposadr[0] for name in ARM_JOINTS]
        self._fingers = [self.model.joint(name).qposadr[0] for name in FINGER_JOINTS]

    def place(self, joints: Array, width: float, midline: Array) -> None:
        """Set joints (7,) [rad], `width` [m] between the pads, the strip's `midline`
        (pieces + 1, 2) [m].
        """
        self.data.qpos[self._joints] = joints
        self.data.qpos[self._fingers] = width / 2
        turn, origin = self._frame[:3, :3], self._frame[:3, 3]
        for number, (start, end) in enumerate(zip(midline, midline[1:], strict=False)):
            (x, z), (along, up) = (start + end) / 2, end - start
            lean = np.arctan2(up, along)
            body = np.array(
                [[np.cos(lean), 0, -np.sin(lean)], [0, 1, 0], [np.sin(lean), 0, np.cos(lean)]]
            )
            self.data.mocap_pos[number] = origin + turn @ (x, 0.0, z)
            mujoco.mju_mat2Quat(self.data.mocap_quat[number], (turn @ body).ravel())
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_collision(self.model, self.data)

    def grip_objection(self, edge: Array) -> str:
        """Why the edge at x, z [m], pitch [rad] is not between the pads; else empty."""
        left, right = (self._pad(name) for name in FINGERS)
        opening = (left - right) / np.linalg.norm(left - right)
        x, z, pitch = edge
        turn = self._frame[:3, :3]
        normal = turn @ (-np.sin(pitch), 0.0, np.cos(pitch))
        place = self._frame[:3, 3] + turn @ (x, 0.0, z) - (left + right) / 2
        lean = float(np.arccos(min(abs(opening @ normal), 1.0)))
        if lean > UPRIGHT:
            return f"the pads lean {np.degrees(lean):.1f} deg from the strip's normal"
        beside = float(abs(place @ opening))
        if beside > NEAR:
            return f"the edge is {1e3 * beside:.1f} mm off the middle of the pads"
        within = float(np.linalg.norm(place - (place @ opening) * opening))
        if within > PAD:
            return f"the edge is {1e3 * within:.1f} mm off the pads' centres"
        return ""

    def touching(self) -> Iterator[tuple[str, str, float]]:
        """Yield what touches what, and how deep [m], but pads and strip."""
        for contact in self.data.contact:
            first, second = sorted(self._name(geom) for geom in contact.geom)
            held = first == "pad" and second.startswith("strip")
            if contact.dist < 0.0 and not held:
                yield first, second, -float(contact.dist)

    def _pad(self, finger: str) -> Array:
        """Centre (3,) [m] of the pad of a `finger`: its largest box."""
        body = self.model.body(finger)
        geoms = range(body.geomadr[0], body.geomadr[0] + body.geomnum[0])
        boxes = [g for g in geoms if self.model.geom_type[g] == mujoco.mjtGeom.mjGEOM_BOX]
        largest = max(boxes, key=lambda geom: self.model.geom_size[geom].prod())
        return np.array(self.data.geom_xpos[largest])

    def _name(self, geom: int) -> str:
        """Name of what a geom belongs to; `pad` for the boxes of the fingers."""
        body = self.model.body(self.model.geom_bodyid[geom]).name
        is_box = self.model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_BOX
        if body in FINGERS and is_box:
            return "pad"
        return self.model.geom(geom).name if body == "world" else body


def _add_boxes(world: mujoco.MjsBody, solids: Solids) -> None:
    """Add the boxes of `solids` to the `world`."""
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, solids.frame[:3, :3].ravel())
    for box in solids.boxes:
        low, high = np.array(box.low), np.array(box.high)
        middle = solids.frame[:3, 3] + solids.frame[:3, :3] @ ((low + high) / 2)
        _add_box(world, box.name, (high - low) / 2, pos=middle, quat=quaternion)


def _add_box(body, name, size, *, colour=(0.6, 0.5, 0.4, 1.0), **place) -> None:
    body.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=size,
        contype=AROUND,
        conaffinity=0,
        rgba=colour,
        **place,
    )
