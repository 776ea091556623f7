"""Regions of the image in which the strip can appear, the mask of the hand, and sizes
in pixels.
"""

from dataclasses import dataclass
from math import ceil
from typing import Self, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.calibration import Calibration
from cell.perception.kernels import CELL_PX, PATCH_PX
from drivers.base.geometry import lengths
from drivers.base.types import Array, Image, Pose
from drivers.franka.shapes import FINGER, PALM, TIP_AHEAD, side_view

# m: chosen on the twin's camera of 0.59 mm/px, which sees a pixel of blur
LIGHT_WINDOW = 0.047
HANGING_WINDOW = 0.0053
LONGEST_BRIDGE = 0.026
FINGER_DISTANCE = 0.0176
PROBE_DEPTH = 0.014


@dataclass(frozen=True, slots=True)
class Sizes:
    """Sizes [px] of image windows and of gaps on the strip, for a camera with pixels of
    `scale` [m].
    """

    scale: float  # m/px
    # patches (odd) over whose median light is read: a strip covers less than half
    light: int
    hanging: int  # px (odd) over which an edge-on strip is averaged along its way
    bridge: float  # px, longest break of an edge-on strip that is bridged
    aside: float  # px about the gripper point within which the fingers end the strip
    deep: float  # px to which a line across the outline reaches into the strip

    @classmethod
    def of_camera(cls, calibration: Calibration) -> Self:
        """Sizes [px] for the camera of `calibration`, by its resolution at the image
        centre.

        Windows are at least what a strip of two pixels needs, however coarse the camera
        is.
        """
        lens = calibration.lens
        u, v = np.array(lens.size) / 2
        pixel, following = calibration.to_plane(np.array([(u, v), (u + 1, v)]))
        scale = float(lengths(following - pixel))
        return cls(
            scale=scale,
            light=max(_odd(LIGHT_WINDOW / scale / PATCH_PX), 3),
            hanging=max(_odd(HANGING_WINDOW / scale), 5),
            bridge=LONGEST_BRIDGE / scale,
            aside=FINGER_DISTANCE / scale,
            deep=max(PROBE_DEPTH / scale, 8.0),
        )


def _odd(size: float) -> int:
    """Odd whole number nearest to `size`."""
    return 2 * round((size - 1) / 2) + 1


T = TypeVar("T", bound=np.generic)
STRIP_START = 0.001  # m, right of the clamp that holds the fixed edge
BELOW = 0.009  # m under the resting strip: desk, not yet its front
BEYOND = 0.03  # m past the furthest that the strip can reach
ABOVE_GRIPPER = 0.012  # m above the gripper point
FOLD = 0.09  # m of height that is always searched
LOW_HEIGHT = 0.012  # m of height: free of the resting strip
HIGH_HEIGHT = 0.09  # below the waiting hand
# of its length: where a strip moves, from, free of hand, to, up to
SWEPT = (0.3, 0.85, 1.02, 0.5)
WRIST_LENGTH = 0.60  # m, from the grip
BLUR = 0.003  # m about a hand that an image blurs
HAND_BACK = 0.036  # m behind the near edge: the far side of fingers amid a strip


@dataclass(frozen=True, slots=True)
class Region:
    """Rectangle of an image [px], from `left` and `top` to before `right`
    and `bottom`.
    """

    left: int
    top: int
    right: int
    bottom: int

    @classmethod
    def whole(cls, image: Image) -> Self:
        """Region that covers all of `image` (height, width, ...)."""
        return cls(left=0, top=0, right=image.shape[1], bottom=image.shape[0])

    @property
    def origin(self) -> Array:
        """Image point (2,) u, v [px] of the region's first pixel."""
        return np.array([self.left, self.top], dtype=np.float64)

    def crop(self, image: NDArray[T]) -> NDArray[T]:
        """View of the pixels of `image` (height, width, ...) within the region."""
        return image[self.top : self.bottom, self.left : self.right]

    def cells(self, cell: int) -> tuple[int, int]:
        """Numbers of rows and of columns of square cells, each `cell` [px] wide, that
        cover the region.
        """
        rows = ceil((self.bottom - self.top) / cell)
        return rows, ceil((self.right - self.left) / cell)


def strip_region(calibration: Calibration, length: float, gripper: Pose) -> Region:
    """Region of the image in which a strip of `length` [m] can appear while the gripper
    holds it at pose `gripper`.

    It covers whole cells of CELL_PX. The strip is fixed at x = 0: the region ends on
    the right half way between its length and the gripper.
    """
    half_way = max(length + gripper.x, length) / 2
    x_end = min(half_way, length) + BEYOND
    z_end = max(gripper.z + ABOVE_GRIPPER, FOLD)
    outline = [(STRIP_START, -BELOW), (STRIP_START, z_end)]
    outline += [(x_end, -BELOW), (x_end, z_end)]
    pixels = calibration.to_image(np.array(outline))

    size = np.array(calibration.lens.size)
    first = np.clip(pixels.min(axis=0), 0, size - 2)
    last = np.clip(np.ceil(pixels.max(axis=0)) + 1, 2, size)

    # whole cells
    first = first // CELL_PX * CELL_PX
    end = np.minimum(np.ceil(last / CELL_PX) * CELL_PX, size)
    left, top_row = first.astype(int).tolist()
    right, bottom = end.astype(int).tolist()
    return Region(left=left, top=top_row, right=right, bottom=bottom)


def motion_mask(calibration: Calibration, length: float) -> Image:
    """Mask (height, width) of the image, 255 where a strip of `length` [m] will move in
    front of the background.

    Only above the desk, and below the hand that waits for the grasp.
    """
    start, middle, end, top = (share * length for share in SWEPT)
    outline = [(start, LOW_HEIGHT), (end, LOW_HEIGHT), (end, HIGH_HEIGHT)]
    outline += [(middle, HIGH_HEIGHT), (middle, top), (start, top)]
    return _fill(calibration, outline)


def still_surroundings(calibration: Calibration, length: float = 0.0) -> Image:
    """Mask (height, width), 255 on the desk and about it, below the waiting hand, where
    no strip of `length` [m] can lie or hang.
    """
    mask = _blank(calibration)
    _, top = calibration.to_image(np.array([[length / 2, HIGH_HEIGHT]]))[0]
    mask[max(int(top), 0) :] = 255
    if length:
        mask[strip_zone(calibration, length) > 0] = 0
    return mask


def strip_zone(calibration: Calibration, length: float, low: float = -BELOW) -> Image:
    """Mask (height, width), 255 where a strip of `length` [m] can lie, or hang above
    `low` [m].
    """
    left = STRIP_START
    right = length + BEYOND
    corners = [(left, low), (right, low), (right, length), (left, length)]
    return _fill(calibration, corners)


def _blank(calibration: Calibration) -> Image:
    """Mask (height, width) of zeros."""
    return np.zeros((calibration.lens.height, calibration.lens.width), np.uint8)


def _fill(calibration: Calibration, corners: list[tuple[float, float]]) -> Image:
    """Mask (height, width) of the image, 255 inside the polygon of `corners`, each x
    and z [m] in the plane of the strip's near edge.
    """
    pixels = np.rint(calibration.homography.to_image(np.array(corners)))
    mask = _blank(calibration)
    cv2.fillPoly(mask, [pixels.astype(np.int32)], 255)
    return mask


def without_hand(region: Region, calibration: Calibration, gripper: Pose) -> Image:
    """Mask (height, width) of `region`, 0 where the hand at pose `gripper` may hide the
    strip, else 255.
    """
    # half of the outline along the hand: its tip, fingers, palm and wrist
    palm, palm_aside = PALM[0]
    _, finger_aside = FINGER[-1]
    side = np.array(
        [
            (-TIP_AHEAD - BLUR, -finger_aside - BLUR),
            (palm - BLUR, -finger_aside - BLUR),
            (palm - BLUR, -palm_aside - BLUR),
            (WRIST_LENGTH, -palm_aside - BLUR),
        ]
    )
    outline = np.concatenate([side, side[::-1] * (1, -1)])

    # seen is its near side, and its back farther from the camera
    near = side_view(outline, gripper.as_array()[None])[0]
    view = calibration.viewpoint
    far = near + view.sweep(HAND_BACK) * (view.foot() - near)

    mask = np.full(region.cells(1), 255, np.uint8)
    for corners in (near, far):
        pixels = np.rint(calibration.homography.to_image(corners) - region.origin)
        # far outside of the image, but within what OpenCV draws
        cv2.fillPoly(mask, [np.clip(pixels, -20000, 20000).astype(np.int32)], 0)
    return mask
