"""Detection of marks in images: landmarks that show a moved camera (finger tip at a
known pose, desk's edge), and the calibration pin, a bright disc on a dark plate.
"""

from base64 import b64decode, b64encode
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from math import hypot, nan, pi
from typing import Literal, Self

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field, NonNegativeInt

from calibration.homography import PlaneMap
from drivers.base.errors import ConfigurationError
from drivers.base.readers import LARGEST_SIDE, picture_sides
from drivers.base.settings import Settings
from drivers.base.types import Array, Frame, Image, Pose

TIP_SIDE, DESK_SIDE = 96, 28  # px, sides of the patches
SEARCH_RADIUS = 40  # px around a landmark's old position in which it is searched
# m, z over which the desk's edge is searched, above a lying strip
DESK_HEIGHTS = (0.010, 0.060)
DESK_RANGE = (0.05, 0.55)  # m, x over which patches of the desk's edge lie
DESK_PATCHES = 7
EDGE_ROWS = 4  # px over which the brightness changes at an edge
CONTRAST = 6.0  # grey levels, least change at an edge
MATCH_CORRELATION = 0.6  # correlation from which a landmark counts as found


class LandmarkSettings(Settings):
    """Pose of the empty hand for landmarks, x, z [m], pitch [rad], and the allowed
    shift [mm].

    The hand must be in the image and clear of strips; the pose is the same for all
    strips.
    """

    x: float = Field(0.42, ge=-0.5, le=2.0)
    z: float = Field(0.17, ge=0.05, le=1.0)
    pitch: float = Field(pi / 2, ge=-0.2, le=3.2)
    moved_mm: float = Field(2.5, gt=0, le=20)

    @property
    def pose(self) -> Pose:
        """Pose of the gripper at which landmarks are taken."""
        return Pose(self.x, self.z, self.pitch)


class Landmark(Settings):
    """Landmark: a square image patch, with its kind, top left corner [px], grey levels
    as PNG.
    """

    kind: Literal["tip", "desk"]
    left: NonNegativeInt
    top: NonNegativeInt
    png: str  # base64

    @classmethod
    def cut(
        cls, kind: Literal["tip", "desk"], grey: Image, left: int, top: int, side: int
    ) -> Self:
        """Landmark of `side` [px] at `left`, `top`, cut out of the image `grey`
        (height, width).
        """
        _, content = cv2.imencode(".png", grey[top : top + side, left : left + side])
        return cls(
            kind=kind, left=left, top=top, png=b64encode(bytes(content)).decode("ascii")
        )

    def patch(self) -> Image:
        """Grey levels (side, side) of the landmark; ConfigurationError for a broken
        PNG.
        """
        image: Image | None = None
        with suppress(ValueError):  # of what is no base64
            content = b64decode(self.png, validate=True)
            if all(0 < side <= LARGEST_SIDE for side in picture_sides(content)):
                levels = np.frombuffer(content, np.uint8)
                image = cv2.imdecode(levels, cv2.IMREAD_GRAYSCALE)
        if image is None:
            raise ConfigurationError(
                "landmarks: png: is not a PNG image; calibrate again"
            )
        return image


class Landmarks(Settings):
    """All landmarks of a camera, and the gripper's pose at which they were taken."""

    x: float
    z: float
    pitch: float
    marks: tuple[Landmark, ...]

    @property
    def pose(self) -> Pose:
        """Pose of the gripper at which the landmarks were taken."""
        return Pose(self.x, self.z, self.pitch)


@dataclass(frozen=True, slots=True)
class CameraShift:
    """Apparent shift of the landmarks since the calibration, in the plane of the near
    edge [mm].

    `x`, `z` by the tip, `desk` up by the desk's line; NaN where a landmark is not found
    again.
    """

    x: float
    z: float
    desk: float

    @property
    def distance(self) -> float:
        """Larger of the shifts [mm] by finger tip and desk that are known; NaN without
        any.
        """
        shifts = (abs(self.desk), hypot(self.x, self.z))
        return max(filter(np.isfinite, shifts), default=nan)


def take_landmarks(frame: Frame, pose: Pose, plane_map: PlaneMap) -> Landmarks:
    """Take landmarks from an image (h, w, 3) of the empty hand at rest at `pose`, bare
    desk.

    Raises ConfigurationError where the camera does not see the tip.
    """
    grey = grey_of(frame.image)
    u, v = plane_map.to_image(np.array([[pose.x, pose.z]]))[0]
    left, top = round(u) - TIP_SIDE // 2, round(v) - TIP_SIDE // 2
    height, width = grey.shape
    if not (0 <= left <= width - TIP_SIDE and 0 <= top <= height - TIP_SIDE):
        raise ConfigurationError(
            f"landmarks: the tip at x {pose.x:.2f}, z {pose.z:.2f} m is not in the"
            " image; choose another pose for it"
        )
    tip = Landmark.cut("tip", grey, left, top, TIP_SIDE)
    along = np.linspace(*DESK_RANGE, DESK_PATCHES).tolist()
    desk = filter(None, (_desk_patch(grey, x, plane_map) for x in along))
    return Landmarks(x=pose.x, z=pose.z, pitch=pose.pitch, marks=(tip, *desk))


def camera_shift(
    frame: Frame, landmarks: Landmarks, plane_map: PlaneMap
) -> CameraShift:
    """Shift of `landmarks` in a new image (h, w, 3) of the empty hand, at rest at their
    pose.
    """
    grey = grey_of(frame.image)
    x = z = nan
    desk = []
    for mark in landmarks.marks:
        shift = _find_shift(grey, mark)
        if shift is None:
            continue
        right, up = _shift_mm(mark, shift, plane_map)
        if mark.kind == "tip":
            x, z = right, up
        else:
            desk.append(up)
    return CameraShift(x, z, float(np.median(desk)) if desk else nan)


def _desk_patch(grey: Image, x: float, plane_map: PlaneMap) -> Landmark | None:
    """Landmark on the desk's rear edge, above `x` [m] of the strip's near edge in the
    image.

    None at the border of the image, or where the contrast of its strongest edge is
    weak.
    """
    ends = np.array([(x, z) for z in DESK_HEIGHTS])
    (u, low), (_, high) = plane_map.to_image(ends).tolist()
    left = round(u) - DESK_SIDE // 2
    first, last = round(high), round(low)
    if left < 0 or left + DESK_SIDE > grey.shape[1]:
        return None
    if first < SEARCH_RADIUS or last > len(grey) - SEARCH_RADIUS:
        return None
    rows = grey[first:last, left : left + DESK_SIDE].mean(axis=1)
    steps = np.abs(rows[EDGE_ROWS:] - rows[:-EDGE_ROWS])
    if len(steps) == 0 or steps.max() < CONTRAST:
        return None
    top = first + int(np.argmax(steps)) + EDGE_ROWS // 2 - DESK_SIDE // 2
    return Landmark.cut("desk", grey, left, top, DESK_SIDE)


def _find_shift(grey: Image, mark: Landmark) -> tuple[float, float] | None:
    """Shift (u, v) [px] of a landmark by template matching; None where it is not
    found.
    """
    patch = mark.patch()
    side = len(patch)
    # a level line hides sideways motion
    sideways = SEARCH_RADIUS if mark.kind == "tip" else 0
    left, top = max(mark.left - sideways, 0), max(mark.top - SEARCH_RADIUS, 0)
    right, bottom = mark.left + side + sideways, mark.top + side + SEARCH_RADIUS
    window = grey[top:bottom, left:right]
    if min(window.shape) < side:
        return None
    found = find_patch(window, patch)
    if found is None:
        return None
    u, v = found.tolist()
    return left + u - mark.left, top + v - mark.top


def find_patch(window: Image, patch: Image) -> Array | None:
    """Top left corner (2,) u, v [px] of `patch` (n, n) in the grey `window` (h, w).

    None where it is not found, or has no contrast by which it could be.
    """
    scores = cv2.matchTemplate(window, patch, cv2.TM_CCOEFF_NORMED)
    _, best, _, (u, v) = cv2.minMaxLoc(scores)
    if not best >= MATCH_CORRELATION or np.ptp(patch) == 0:
        return None
    return np.array([u + _peak(scores[v, :], u), v + _peak(scores[:, u], v)])


def _peak(scores: Array, at: int) -> float:
    """Offset [indices] of the peak of `scores` (n,) from `at`, by a parabola through 3
    values.
    """
    if not 0 < at < len(scores) - 1:
        return 0.0
    before, peak, after = scores[at - 1 : at + 2].astype(float).tolist()
    bend = before - 2 * peak + after
    return 0.0 if bend >= 0 else 0.5 * (before - after) / bend


def _shift_mm(
    mark: Landmark, shift: Sequence[float], plane_map: PlaneMap
) -> tuple[float, float]:
    """Convert the `shift` of a landmark [px] to x, z [mm] in the plane of the near
    edge.
    """
    side = TIP_SIDE if mark.kind == "tip" else DESK_SIDE
    middle = np.array([mark.left, mark.top]) + side / 2
    before, now = plane_map.to_plane(np.array([middle, middle + shift]))
    x, z = (1e3 * (now - before)).tolist()
    return x, z


def grey_of(image: Image) -> Image:
    """Grey levels (h, w) of a colour `image` (h, w, 3)."""
    grey: Image = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    return grey


# grey levels of the darkest channel of a lit disc, and of one in shadow
LIT_LEVELS = (170, 110)
PLATE_CONTRAST = 90.0  # grey levels between disc and plate
RADII = (3.0, 30.0)  # px, range of radii of the disc
ROUND = 0.75  # share of its circumscribed circle that the disc fills
WINDOW_REACH, PLATE_EDGE, INSIDE = 1.7, 1.25, 0.7  # over the disc's radius
DARK_SHARE = 0.1  # of the contrast, brightness above the plate that carries no weight


def find_pointer(image: Image) -> Array | None:
    """Centre (2,) u, v [px] of the pin's disc in `image` (h, w, 3); None unless exactly
    one.
    """
    darkest = cv2.min(cv2.min(image[..., 0], image[..., 1]), image[..., 2])
    for level in LIT_LEVELS:
        _, bright = cv2.threshold(darkest, level, 255, cv2.THRESH_BINARY)
        outlines, _ = cv2.findContours(bright, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        discs = [_disc(darkest, outline) for outline in outlines]
        centres = [centre for centre in discs if centre is not None]
        if centres:
            return centres[0] if len(centres) == 1 else None
    return None


def _disc(grey: Image, outline: NDArray[np.int32]) -> Array | None:
    """Centre (2,) u, v [px] of the disc in `outline`, or None without a disc on a dark
    plate.
    """
    (u, v), radius = cv2.minEnclosingCircle(outline)
    if not RADII[0] <= radius <= RADII[1]:
        return None
    if cv2.contourArea(outline) < ROUND * np.pi * (radius - 0.5) ** 2:
        return None

    column, row = round(u), round(v)
    reach = int(np.ceil(WINDOW_REACH * radius)) + 2
    window = grey[
        max(row - reach, 0) : row + reach + 1,
        max(column - reach, 0) : column + reach + 1,
    ]
    dv, du = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    if window.shape != du.shape:
        return None

    distance = np.hypot(du - (u - column), dv - (v - row))
    beyond_disc = distance > PLATE_EDGE * radius + 1
    plate = np.median(window[beyond_disc & (distance < reach)])
    disc = np.median(window[distance < INSIDE * radius])
    if disc - plate < PLATE_CONTRAST:
        return None

    brightness = (window - plate) / (disc - plate)
    weight = np.clip(brightness - DARK_SHARE, 0.0, 1.0 - DARK_SHARE)
    weight[distance > PLATE_EDGE * radius + 2] = 0.0
    off = np.array([(weight * du).sum(), (weight * dv).sum()]) / weight.sum()
    centre: Array = np.array([column, row]) + off
    return centre
