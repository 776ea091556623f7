"""Bodies of a cell in Rerun's 3D view: desk, clamp, arm or hand, camera, strip.

The view's frame is the cell's: x along the strip, z up. Its y [m] leads away from the
camera, with the strip's near edge at 0; the hand is centred on the strip's width.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from calibration.calibration import Calibration
from drivers.base.geometry import EDGE_AHEAD, CellInRobot, even_points
from drivers.base.installation import Installation
from drivers.base.types import Array
from drivers.franka.collision import CAPSULES, link_frames
from drivers.franka.kinematics import (
    FLANGE,
    HAND_TO_TIP,
    PARAMETERS,
    offset_in_frame,
)
from drivers.franka.plane import StripPlane
from drivers.franka.shapes import (
    FINGER,
    FINGER_WIDTH,
    PALM,
    PALM_WIDTH,
    boxes,
    desk_end,
)

WORLD = "world"
BODIES, PATH = f"{WORLD}/desk", f"{WORLD}/path"
CAMERA, IMAGE = f"{WORLD}/camera", f"{WORLD}/camera/image"
ARM = f"{WORLD}/arm"
HAND_LINK = 8  # among the frames of `link_frames`: base, seven joints, hand
LINKS = [f"{ARM}/link{number}" for number in range(HAND_LINK + 1)]

SEEN_RGBA, MODEL_RGBA, PATH_RGBA = 0xFFAA32FF, 0x4F8BD6FF, 0xC9CED6FF
DESK_RGB, CLAMP_RGB = (92, 108, 116), (150, 152, 156)
ARM_RGB, JOINT_RGB, FINGER_RGB = (225, 228, 232), (120, 126, 134), (168, 174, 182)
BACKGROUND_RGB = (30, 34, 40)
SOLID = rr.components.FillMode.Solid

SLAB = 0.03  # m of the desk that are drawn
BEYOND, DESK_SHOWN = 0.12, 0.16  # m of the desk around the strip, about its middle
BACKDROP = 0.65  # m behind the strip's plane, at which the image hangs
LINE, EDGE = 0.0012, 0.0018  # m, radii of lines
APART = 0.008  # m before the measured strip, at which the simulated one is drawn
NODES = 48  # points along a drawn strip
# m, radii of what joins one joint to the next, from the base on
BONES = (0.075, 0.065, 0.062, 0.06, 0.058, 0.05, 0.045)
DRUM_LINKS = (2, 4, 6)  # whose collision capsules look like the arm's joints
DRUM_SHARE = 1.02  # by which a joint stands out
# of the view, in lengths of the strip: from where one looks at what
EYE, TARGET = np.array([-0.35, -1.5, 1.0]), np.array([0.52, 0.1, 0.3])


@dataclass(frozen=True, slots=True)
class Capsule:
    """Rod with round ends from `start` to `end` (3,) [m], with its `radius` [m]."""

    start: Array
    end: Array
    radius: float
    rgb: tuple[int, int, int]


def surroundings(length: float, width: float, cell: Installation) -> Mapping[str, Any]:
    """Static bodies by entity around a strip of `length` and `width` [m]."""
    bodies: dict[str, Any] = {WORLD: rr.ViewCoordinates.RIGHT_HAND_Z_UP}
    middle, low = 0.5 * width, (-BEYOND, -DESK_SHOWN, -SLAB)
    high = (length + BEYOND, DESK_SHOWN, SLAB)
    for number, box in enumerate(boxes(desk_end(cell, length))):
        if box.name == "floor":
            continue
        shift = np.array([0.0, middle, -LINE])  # under the lines on the desk
        lowest, highest = np.clip([box.low, box.high], low, high) + shift
        rgb = DESK_RGB if box.name.startswith("desk") else CLAMP_RGB
        bodies[f"{BODIES}/{number}"] = _box(lowest, highest, rgb)
    return bodies


def camera(calibration: Calibration, scale: float) -> Mapping[str, Any]:
    """Static camera by entity; its images are `scale` times as large as those taken."""
    lens, view = calibration.lens, calibration.viewpoint
    columns = np.linalg.solve(lens.matrix, calibration.homography.inverse)
    along, up = (column / np.linalg.norm(column) for column in columns.T[:2])
    axes = np.column_stack([along, np.cross(up, along), up])
    left, _, right = np.linalg.svd(axes)
    pinhole = rr.Pinhole(
        image_from_camera=np.diag([scale, scale, 1.0]) @ lens.matrix,
        resolution=[scale * side for side in lens.size],
        image_plane_distance=view.distance + BACKDROP,
        color=0x464C54FF,
        line_width=-0.7,
    )
    transform = rr.Transform3D(
        translation=[view.x, -view.distance, view.z], mat3x3=(left @ right).T
    )
    return {CAMERA: transform, IMAGE: pinhole}


def hand_bodies() -> Mapping[str, Any]:
    """Static shapes of the closed hand by entity, in the hand's frame."""
    hand, tip = LINKS[HAND_LINK], EDGE_AHEAD + float(HAND_TO_TIP[2, 3])
    (top, half), (back, _) = PALM
    palm = (-PALM_WIDTH / 2, -half, tip - back), (PALM_WIDTH / 2, half, tip - top)
    bodies = {f"{hand}/palm": _box(*palm, ARM_RGB)}
    (ahead, _), *_, (behind, thick) = FINGER
    for number, (near, far) in enumerate(((-thick, 0.0), (0.0, thick))):
        low = (-FINGER_WIDTH / 2, near, tip - behind)
        high = (FINGER_WIDTH / 2, far, tip - ahead)
        bodies[f"{hand}/finger{number}"] = _box(low, high, FINGER_RGB)
    return bodies


def arm_bodies() -> Mapping[str, Any]:
    """Static shapes of the arm without its hand by entity, each in the frame of its
    link.
    """
    links = enumerate(LINKS[:HAND_LINK])
    return {entity: _capsules(_rods(link)) for link, entity in links}


def arm_frames(q: Array, cell: Installation, width: float) -> Array:
    """Frames (n, 9, 4, 4) of base, joints and hand in the view, for joints `q` (n, 7)
    [rad].
    """
    base = np.linalg.inv(cell.mounting.transform().matrix)
    base[1, 3] += 0.5 * width
    frames: Array = base @ link_frames(q)
    return frames


def hand_frame(pose: Array, width: float) -> Array:
    """Frame (4, 4) of the hand in the view, for a gripper `pose` (3,) [m, rad]."""
    plane = StripPlane(CellInRobot(np.eye(4)))
    frame = plane.matrix(*pose.tolist()) @ np.linalg.inv(HAND_TO_TIP)
    frame[1, 3] += 0.5 * width
    return frame


def transforms(frames: Array) -> Any:
    """Columns of frames (n, 4, 4)."""
    return rr.Transform3D.columns(
        translation=frames[:, :3, 3], mat3x3=list(frames[:, :3, :3])
    )


def from_fixed_edge(profile: Array) -> Array:
    """Midline (NODES, 2) [m] of a strip that lies flat up to its lifted `profile`
    (n, 2).
    """
    return even_points(np.vstack([np.zeros((1, 2)), profile]), NODES)


def strip_look(rgb: Sequence[int]) -> Any:
    """Static look of a band of NODES points, lighter than the cloth's colour `rgb`."""
    first = 2 * np.arange(NODES - 1)[:, None]
    halves = np.array([[0, 1, 2], [1, 3, 2]])
    triangles = (first[:, None] + halves).reshape(-1, 3)
    light = [min(255, round(60 + 1.3 * value)) for value in rgb]
    colour = [*light, 255]
    return rr.Mesh3D.from_fields(triangle_indices=triangles, albedo_factor=colour)


def bands(midlines: Sequence[Array], width: float) -> Any:
    """Columns of bands of `width` [m] along midlines (NODES, 2) [m]."""
    corners = [_pairs(line, width) for line in midlines]
    normals = [_normals(line) for line in midlines]
    columns = rr.Mesh3D.columns(
        vertex_positions=np.concatenate(corners), vertex_normals=np.concatenate(normals)
    )
    return columns.partition([2 * NODES] * len(midlines))


def at_depth(points: Array, y: float) -> NDArray[np.float32]:
    """Points (n, 3) of `points` (n, 2) x, z [m] at depth `y` [m]."""
    deep = np.column_stack([points[:, 0], np.full(len(points), y), points[:, 1]])
    return deep.astype(np.float32)


def lines(curves: Sequence[NDArray[np.float32]]) -> Any:
    """Columns of curves (n, 3) [m], one a row."""
    return rr.LineStrips3D.columns(strips=list(curves))


def view(
    length: float,
    origin: str,
    name: str,
    hidden: Sequence[str] = (),
    nearness: float = 1.0,
) -> Any:
    """3D view of the entities under `origin` but the `hidden` ones, which looks at a
    strip of `length` [m].

    The eye is at `nearness` of the distance from which an arm is seen whole.
    """
    eye = rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital,
        position=length * (TARGET + nearness * (EYE - TARGET)),
        look_target=length * TARGET,
        eye_up=[0, 0, 1],
    )
    flat = rrb.BackgroundKind.SolidColor
    return rrb.Spatial3DView(
        origin=origin,
        contents=[f"{origin}/**", *(f"- {entity}" for entity in hidden)],
        name=name,
        eye_controls=eye,
        line_grid=rrb.LineGrid3D(visible=False),
        background=rrb.Background(kind=flat, color=BACKGROUND_RGB),
    )


def _pairs(midline: Array, width: float) -> NDArray[np.float32]:
    """Corners (2 n, 3) [m] of a band: its near and far edge in turn."""
    near, far = at_depth(midline, 0.0), at_depth(midline, width)
    return np.stack([near, far], axis=1).reshape(-1, 3)


def _normals(midline: Array) -> NDArray[np.float32]:
    """Normals (2 n, 3) of a band at its corners."""
    along = np.gradient(midline, axis=0)
    upright = np.column_stack([-along[:, 1], along[:, 0]])
    upright /= np.linalg.norm(upright, axis=1)[:, None] + 1e-12
    return np.repeat(at_depth(upright, 0.0), 2, axis=0)


def _rods(link: int) -> list[Capsule]:
    """Rods of a `link` of the arm in its frame: bones to the next joint, and its
    drum.
    """
    origin = np.zeros(3)
    if link == len(PARAMETERS):
        return [Capsule(origin, np.array([0.0, 0.0, FLANGE]), BONES[-1], ARM_RGB)]
    knee = np.array([PARAMETERS[link, 0], 0.0, 0.0])
    following = np.array([knee[0], *offset_in_frame(link)])
    bones = [(origin, knee), (knee, following)]
    rods = [
        Capsule(start, end, BONES[link], ARM_RGB)
        for start, end in bones
        if not np.array_equal(start, end)
    ]
    for owner, start, end, radius in CAPSULES:
        if owner == link and link in DRUM_LINKS:
            drum = np.array(start), np.array(end)
            rods.append(Capsule(*drum, DRUM_SHARE * radius, JOINT_RGB))
    return rods


def _capsules(rods: Sequence[Capsule]) -> Any:
    """Solid capsules of `rods`."""
    spans = np.array([rod.end - rod.start for rod in rods]).reshape(-1, 3)
    lengths = np.linalg.norm(spans, axis=1)
    return rr.Capsules3D(
        lengths=lengths,
        radii=[rod.radius for rod in rods],
        translations=[rod.start for rod in rods],
        quaternions=[
            Rotation.align_vectors(span, (0.0, 0.0, 1.0))[0].as_quat() for span in spans
        ],
        colors=[rod.rgb for rod in rods],
        fill_mode=SOLID,
    )


def _box(low: ArrayLike, high: ArrayLike, rgb: Sequence[int]) -> Any:
    """Solid box between two corners (3,) [m]."""
    sizes = [np.subtract(high, low)]
    return rr.Boxes3D(mins=[low], sizes=sizes, colors=[rgb], fill_mode=SOLID)
