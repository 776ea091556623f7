"""Drawing of the simulated hand: two fingers about the strip's edge, or the calibration
pin.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drivers.base.geometry import lengths
from drivers.base.types import Array, Image
from drivers.franka.shapes import (
    FINGER_WIDTH,
    PALM,
    PALM_WIDTH,
    block,
    finger,
    side_view,
)
from drivers.twin.renderer.optics import Optics
from drivers.twin.renderer.stage import fill, hull
from drivers.twin.world import WorldState

WRIST = ((0.13, 0.05), (0.60, 0.05))  # m: behind the grip, half of it across
WRIST_DEPTH = 0.1  # m in y
PALE = 2.2  # brightness of the wrist over that of the hand
PLATE, DISC = 0.014, 0.005  # m, radii of the pin's dark plate and bright disc
DISC_LEVELS = np.array([236.0, 240.0, 240.0])


@dataclass(frozen=True, slots=True)
class Outline:
    """Prism that is a part of the drawn hand: convex `corners` (m, 2) of x, z [m], from
    `front` to `back` in y [m].
    """

    corners: Array
    front: float
    back: float
    shade: float


def outlines(scene: WorldState, middle: float, floor: float) -> list[Outline]:
    """Prisms of wrist, palm and fingers in drawing order, centred at y = `middle` [m]
    and cut off below z = `floor` [m].
    """
    width = 0.0 if scene.pointer else scene.finger_width
    parts = (
        (block(WRIST), WRIST_DEPTH, PALE),
        (block(PALM), PALM_WIDTH, 1.0),
        (finger(width, -1.0), FINGER_WIDTH, 1.0),
        (finger(width, 1.0), FINGER_WIDTH, 1.0),
    )
    pose = scene.gripper.as_array()[None]

    placed = []
    for corners, depth, shade in parts:
        seen = _clip_above(side_view(corners, pose)[0], floor)
        if len(seen) > 2:
            half = depth / 2
            placed.append(
                Outline(
                    corners=seen, front=middle - half, back=middle + half, shade=shade
                )
            )
    return placed


def faces_of(parts: Sequence[Outline], optics: Optics) -> list[tuple[Array, Array]]:
    """Corners [px] of the front and of the back face of each prism in `parts`, one row
    (u, v) per corner.
    """
    return [
        (optics.plane(part.corners, part.front), optics.plane(part.corners, part.back))
        for part in parts
    ]


def draw_hand(
    image: Image,
    parts: Sequence[Outline],
    faces: Sequence[tuple[Array, Array]],
    origin: tuple[int, int],
    colour: Array,
) -> None:
    """Draw prisms of the hand, darker at the sides than in front, into `image` (h, w,
    3).

    `faces` are in pixels of a larger image, in which this one begins at `origin` (u,
    v).
    """
    for part, face in zip(parts, faces, strict=True):
        near, far = (corners - origin for corners in face)
        fill(image, hull(near, far), colour * 0.7 * part.shade)
        fill(image, near, colour * part.shade)


def draw_pointer(
    image: Image, scene: WorldState, optics: Optics, colour: Array
) -> None:
    """Draw the calibration pin into `image` (height, width, 3): a dark plate with a
    bright disc at the point between the fingers.
    """
    centre = np.array([scene.gripper.x, scene.gripper.z])
    _disc(image, centre, radius=PLATE, optics=optics, colour=colour * 0.5)
    _disc(image, centre, radius=DISC, optics=optics, colour=DISC_LEVELS)


def _disc(
    image: Image, centre: Array, radius: float, optics: Optics, colour: Array
) -> None:
    """Draw a disc of `radius` [m] about `centre` (x, z) [m] in the plane y = 0 into
    `image`, with an antialiased border.
    """
    middle, beside, above = optics.plane(
        centre + radius * np.array([(0, 0), (1, 0), (0, 1)])
    )
    # (2, 2) px, conjugate radii of the ellipse seen
    axes = np.stack([beside, above]) - middle
    reach = int(np.abs(axes).sum(axis=0).max()) + 2
    left, top = (max(round(p) - reach, 0) for p in middle.tolist())
    side = 2 * reach + 1
    part = image[top : top + side, left : left + side]
    if part.size == 0:
        return

    rows, columns = np.indices(part.shape[:2])
    pixels = np.stack([columns + left, rows + top], axis=-1)
    in_radii = (pixels - middle) @ np.linalg.inv(axes)
    inwards = 1 - lengths(in_radii)  # from the border, in radii
    cover = np.clip(inwards * lengths(axes[0]) + 0.5, 0, 1)[..., None]
    part[:] = part + cover * (colour - part) + 0.5


def extent(
    faces: Sequence[tuple[Array, Array]], scene: WorldState, optics: Optics
) -> Array:
    """Pixels, one row (u, v) each, that bound the hand's `faces` and the calibration
    pin where the hand holds it.
    """
    bounds = [np.empty((0, 2))]
    for near, far in faces:
        bounds += [near, far]
    if scene.pointer:
        centre = np.array([scene.gripper.x, scene.gripper.z])
        square = np.array([(-1, -1), (1, 1), (1, -1), (-1, 1)])
        bounds.append(optics.plane(centre + PLATE * square))
    return np.concatenate(bounds)


def _clip_above(outline: Array, floor: float) -> Array:
    """Part of a convex `outline`, rows of x and z [m], that lies above z =
    `floor` [m].
    """
    if (outline[:, 1] >= floor).all():
        return outline
    corners: list[Array] = []
    for start, end in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        if start[1] >= floor:
            corners.append(start)
        if (start[1] >= floor) != (end[1] >= floor):
            corners.append(
                start + (floor - start[1]) / (end[1] - start[1]) * (end - start)
            )
    return np.array(corners)
