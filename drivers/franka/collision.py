"""Collision model of the Franka Research 3 with its hand: spheres, and distances from
boxes.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drivers.base.types import Array, frozen
from drivers.franka.kinematics import FLANGE, FLANGE_TO_HAND, PUBLISHED, frames
from drivers.franka.shapes import BoxObstacle

CAPSULES = PUBLISHED["capsules"]  # frame, ends of the axis [m], radius [m]
SPHERE_SPACING = 0.02  # m at most between spheres along an axis
# links up to the first never touch links from the second on
LOW_LINKS, HIGH_LINKS = 3, 6
# first link that can meet what stands around the robot: those below turn on the spot
FIRST_MOVABLE_LINK = 2


def _spheres() -> tuple[Array, Array, Array]:
    """Centres (m, 3) [m] in their link's frame, radii (m,) [m] and links (m,) of all
    spheres.
    """
    rows = []
    for link, first, last, radius in CAPSULES:
        begin = np.array(first)
        end = np.array(last)
        count = 1 + int(np.ceil(np.linalg.norm(end - begin) / SPHERE_SPACING))
        rows += [(*point, radius, link) for point in np.linspace(begin, end, count)]
    table = np.array(rows)
    return frozen(table[:, :3]), frozen(table[:, 3]), frozen(table[:, 4])


CENTRES, RADII, _LINKS = _spheres()
SPHERE_LINKS = _LINKS.astype(int)
_LOW, _HIGH = SPHERE_LINKS <= LOW_LINKS, SPHERE_LINKS >= HIGH_LINKS
_MOVABLE = SPHERE_LINKS >= FIRST_MOVABLE_LINK


def link_frames(q: Array) -> Array:
    """Frames (..., 9, 4, 4) of base, seven joints and hand in the robot's base, for
    joints (..., 7) [rad].
    """
    joints = frames(q)
    shape = joints.shape[:-3]
    flange = np.eye(4)
    flange[2, 3] = FLANGE
    hand = joints[..., 6, :, :] @ flange @ FLANGE_TO_HAND
    base = np.broadcast_to(np.eye(4), (*shape, 4, 4))
    return np.concatenate(
        [base[..., None, :, :], joints, hand[..., None, :, :]], axis=-3
    )


def _sphere_centres(q: Array) -> Array:
    """Centres (..., m, 3) [m] of the collision spheres of arm and hand, in the robot's
    base.

    The joints `q` are (..., 7) [rad]; RADII (m,) [m] are the spheres' radii.
    """
    links = link_frames(q)[..., SPHERE_LINKS, :, :]
    centres: Array = (
        np.einsum("...mij,mj->...mi", links[..., :3, :3], CENTRES) + links[..., :3, 3]
    )
    return centres


def self_clearance(q: Array) -> Array:
    """Distance (...,) [m] of the wrist and hand from the base and the upper arm at
    joints (..., 7) [rad]; negative where they overlap.
    """
    centres = _sphere_centres(q)
    low = centres[..., _LOW, :]
    high = centres[..., _HIGH, :]
    between = np.linalg.norm(low[..., :, None, :] - high[..., None, :, :], axis=-1)
    gaps = between - RADII[_LOW][:, None] - RADII[_HIGH]
    clearance: Array = gaps.min(axis=(-1, -2))
    return clearance


@dataclass(frozen=True, slots=True)
class Solids:
    """Box-shaped obstacles of the arm in a `frame` (4, 4), which is given in the
    robot's base.
    """

    frame: Array
    boxes: Sequence[BoxObstacle]

    def clearance(self, q: Array) -> Array:
        """Distance (..., k) [m] of the arm at joints (..., 7) [rad] from k boxes;
        negative inside.

        Base and first link are left out, as part of the stand.
        """
        centres = _sphere_centres(q)[..., _MOVABLE, :]
        turn = self.frame[:3, :3]
        origin = self.frame[:3, 3]
        within = ((centres - origin) @ turn)[..., None, :, :]
        low, high = np.array([(box.low, box.high) for box in self.boxes]).swapaxes(0, 1)
        beyond = np.maximum(low[:, None] - within, within - high[:, None])
        outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=-1)
        inside = np.minimum(beyond.max(axis=-1), 0.0)
        gaps: Array = (outside + inside - RADII[_MOVABLE]).min(axis=-1)
        return gaps
