"""The maker's model of the arm with its hand over desk, clamp and strip, in MuJoCo.

The model is read from the package of others that carries it; nothing of it is ours.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from drivers.base.types import Array
from drivers.franka.collision import Solids
from drivers.strip.file import StripFile

NEAR = 0.003  # m of the strip's edge from the middle between the pads
UPRIGHT = np.radians(3.0)  # of the pads' normal against that of the strip
PAD = 0.0085  # m, half of a pad along the fingers
PIECES = 60  # of the strip
# pieces at the grasped edge that drape over the fingers' ends, and how deep they may
# [m]: the strip's model knows a grip, and no fingers
HELD_PIECES, DRAPED = 4, 0.008
ROBOT, AROUND = 1, 2  # bits of what may touch
FINGERS = ("left_finger", "right_finger")
ARM_JOINTS = [f"fr3_joint{number}" for number in range(1, 8)]
FINGER_JOINTS = ("finger_joint1", "finger_joint2")
BOX = mujoco.mjtGeom.mjGEOM_BOX
WOOD, CLOTH = (0.75, 0.65, 0.5, 1.0), (0.15, 0.3, 0.75, 1.0)


@dataclass(frozen=True, slots=True)
class Moment:
    """Strip's held edge at `pose` x, z [m], pitch [rad], the arm's joints (7,) [rad],
    `width` [m] between the fingers, the midline (n, 2) [m], and whether it is `held`.
    """

    pose: Array
    joints: Array
    width: float
    midline: Array
    held: bool


class MakerScene:
    """Arm, hand, `solids` and a strip of PIECES boxes, moved without dynamics."""

    def __init__(self, path: Path, solids: Solids, strip: StripFile) -> None:
        spec = mujoco.MjSpec.from_file(str(path))
        spec.meshdir = str(path.parent / "meshes")
        for geom in spec.geoms:
            solid = geom.classname.name.startswith(("collision", "fingertip"))
            bits = (ROBOT, ROBOT | AROUND) if solid else (0, 0)
            geom.contype, geom.conaffinity = bits
        self._frame = solids.frame
        self._add_solids(spec, solids)
        size = [strip.length / PIECES / 2, strip.width / 2, strip.thickness / 2]
        for number in range(PIECES):
            piece = spec.worldbody.add_body(mocap=True)
            _add_box(piece, f"strip_{PIECES - 1 - number}", size, rgba=CLOTH)
        spec.visual.headlight.ambient = [0.5, 0.5, 0.5]
        spec.add_texture(
            name="sky",
            type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
            builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
            rgb1=[1.0, 1.0, 1.0],
            width=8,
            height=48,
        )
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self._joints, self._fingers = (
            [self.model.joint(name).qposadr[0] for name in names]
            for names in (ARM_JOINTS, FINGER_JOINTS)
        )

    def _add_solids(self, spec: mujoco.MjSpec, solids: Solids) -> None:
        """Add the boxes of `solids` to the world of `spec`."""
        turn, origin = self._frame[:3, :3], self._frame[:3, 3]
        leaning = _quaternion(turn)
        for box in solids.boxes:
            low, high = np.array(box.low), np.array(box.high)
            middle = origin + turn @ ((low + high) / 2)
            place = {"pos": middle, "quat": leaning, "rgba": WOOD}
            _add_box(spec.worldbody, box.name, (high - low) / 2, **place)

    def place(self, joints: Array, width: float, midline: Array) -> None:
        """Set joints (7,) [rad], `width` [m] between the pads, and the strip's
        `midline` (n, 2) [m].
        """
        data = self.data
        ends = np.linspace(0, len(midline) - 1, PIECES + 1).round().astype(int)
        data.qpos[self._joints] = joints
        data.qpos[self._fingers] = width / 2
        turn, origin = self._frame[:3, :3], self._frame[:3, 3]
        for number, (start, end) in enumerate(pairwise(midline[ends])):
            (x, z), (along, up) = (start + end) / 2, end - start
            c, s = np.array([along, up]) / np.hypot(along, up)
            leaning = turn @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])
            data.mocap_pos[number] = origin + turn @ (x, 0.0, z)
            data.mocap_quat[number] = _quaternion(leaning)
        mujoco.mj_kinematics(self.model, data)
        mujoco.mj_collision(self.model, data)

    def judge(self, moments: Iterable[Moment]) -> tuple[int, list[str]]:
        """How many of the `moments` hold the strip, and what is wrong in any of
        them.
        """
        held, wrong = 0, list[str]()
        for moment in moments:
            held += moment.held
            self.place(moment.joints, moment.width, moment.midline)
            grip = self.grip_objection(moment.pose) if moment.held else ""
            found = [*self.touching(), *filter(None, [grip])]
            wrong += [f"{text} at {moment.joints.round(2)}" for text in found]
        return held, wrong

    def grip_objection(self, edge: Array) -> str:
        """Reason why the edge at x, z [m], pitch [rad] is not between the pads; else
        empty.
        """
        left, right = (self._pad(name) for name in FINGERS)
        opening = (left - right) / np.linalg.norm(left - right)
        x, z, pitch = edge
        turn = self._frame[:3, :3]
        normal = turn @ (-np.sin(pitch), 0.0, np.cos(pitch))
        lean = float(np.arccos(min(abs(opening @ normal), 1.0)))
        if lean > UPRIGHT:
            return f"the pads lean {np.degrees(lean):.1f} deg from the strip's normal"
        place = self._frame[:3, 3] + turn @ (x, 0.0, z) - (left + right) / 2
        beside = float(abs(place @ opening))
        if beside > NEAR:
            return f"the edge is {1e3 * beside:.1f} mm off the middle of the pads"
        within = float(np.linalg.norm(place - (place @ opening) * opening))
        return "" if within < PAD else f"the edge is {1e3 * within:.1f} mm off the pads"

    def touching(self) -> Iterator[str]:
        """Yield what touches what, and how deep, but pads and strip."""
        for contact in self.data.contact:
            names = sorted(self._name(geom) for geom in contact.geom)
            depth = -float(contact.dist)
            if depth > 0.0 and not _may_touch(*names, depth):
                yield f"{' and '.join(names)}, {1e3 * depth:.1f} mm"

    def _pad(self, name: str) -> Array:
        """Centre (3,) [m] of the pad of a finger: its largest box."""
        finger = self.model.body(name)
        first, count = int(finger.geomadr[0]), int(finger.geomnum[0])
        sizes = self.model.geom_size[first : first + count].prod(axis=1)
        is_box = self.model.geom_type[first : first + count] == BOX
        return np.array(self.data.geom_xpos[first + int(np.argmax(sizes * is_box))])

    def _name(self, geom: int) -> str:
        """Name of what a geom belongs to; `pad` for the boxes of the fingers."""
        model = self.model
        body = model.body(model.geom_bodyid[geom]).name
        if body in FINGERS:
            return "pad" if model.geom_type[geom] == BOX else "finger"
        return body or model.geom(geom).name


def _may_touch(first: str, second: str, depth: float) -> bool:
    """Whether a strip may be met as deep [m] as it is: by pads, and its end by
    fingers.
    """
    if not second.startswith("strip_"):
        return False
    draped = int(second[6:]) < HELD_PIECES and depth < DRAPED
    return first == "pad" or (first == "finger" and draped)


def _quaternion(turn: Array) -> Array:
    """Quaternion (4,) of a rotation matrix `turn` (3, 3)."""
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, turn.ravel())
    return quaternion


def _add_box(body: Any, name: str, size: Any, **place: Mapping[str, Any]) -> None:
    """Add a box that the robot may not touch, of half `size` (3,) [m], to `body`."""
    body.add_geom(
        name=name, type=BOX, size=size, contype=AROUND, conaffinity=0, **place
    )
