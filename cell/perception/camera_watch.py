"""Detection of a frozen camera, and of a camera that was moved since the preflight."""

from dataclasses import dataclass
from math import hypot, nan
from typing import Self

import cv2
import numpy as np

from calibration.calibration import Calibration
from calibration.landmarks import find_patch, grey_of
from cell.perception.preflight import PreflightCheck
from cell.perception.region import HIGH_HEIGHT, Region, strip_zone, without_hand
from cell.perception.scene import Appearance
from drivers.base.types import Array, Frame, Image, Pose
from drivers.strip.file import StripFile

MOVED_DISTANCE = 0.002  # m of gripper motion after which an image must differ
FINGER_LENGTH = 0.045  # m
STRIDE = 64  # rows from one to the next that are compared first


class FrozenImages:
    """Detects a camera that repeats one image, by comparing every frame with the one
    before.

    A camera is frozen when it repeats the same image, byte for byte, although the
    gripper has moved. Equal images of a scene at rest prove nothing: a camera without
    noise delivers them.
    """

    def __init__(self) -> None:
        self._last: Frame | None = None
        self._gripper: Pose | None = None
        self._identical = 0

    def count(self, frame: Frame, gripper: Pose) -> int:
        """Number of equal images in a row, up to `frame`, between which the gripper
        moved.

        `gripper` is the measured pose at the frame's stamp; 1 for a new image.
        """
        last = self._last
        if last is None or self._gripper is None or not _equal(last.image, frame.image):
            self._gripper = gripper
            self._identical = 1
        elif _distance(self._gripper, gripper) > MOVED_DISTANCE:
            self._identical += 1
        self._last = frame
        return self._identical


def _equal(one: Image, other: Image) -> bool:
    """Whether two images are equal; a few rows are compared first, which mostly
    suffices.
    """
    first = slice(None, None, STRIDE)
    return np.array_equal(one[first], other[first]) and np.array_equal(one, other)


def _distance(one: Pose, other: Pose) -> float:
    """Larger of the gripper's displacement [m] between poses and the arc [m] of its
    finger tips.
    """
    turn = FINGER_LENGTH * abs(one.pitch - other.pitch)
    return max(hypot(one.x - other.x, one.z - other.z), turn)


PATCH_SIZE = 32  # px, of a patch
SEARCH_RADIUS = 12  # px about a patch's place in which it is searched
MOST_PATCHES = 16  # patches that are kept
FEWEST_PATCHES = 2  # patches that must be found to state a shift
ALONG = 1.0  # px within which the shifts of most patches must agree
# px, standard deviation of a patch's place by its structure and the noise
PATCH_SIGMA = 0.3
NOISE_WINDOW = 1.5  # px over which noise is averaged
CAMERA_WATCHED = "camera is watched"  # name of the check
UNWATCHED = "camera is not watched"  # its name where too few patches are known


@dataclass(frozen=True, slots=True)
class CameraWatch:
    """Image patches of the still surroundings, by which motion of the camera is
    detected.

    They lie on the desk and about it, where nothing hides them for long: `corners` (n,
    2), column and row [px] of their first pixels, `patches`, their grey levels
    (PATCH_SIZE, PATCH_SIZE), and `weights` (n,), the inverse variances [1/px^2] of
    their places.
    """

    corners: Array
    patches: tuple[Image, ...]
    weights: Array
    calibration: Calibration

    @classmethod
    def choose(
        cls, appearance: Appearance, calibration: Calibration, strip: StripFile
    ) -> Self:
        """Choose the patches whose shift is measured best, away from strip and waiting
        hand.
        """
        grey = grey_of(appearance.scene.background.image)
        sigma = _place_deviation(grey, appearance.scene.sensor)
        hidden = strip_zone(calibration, strip.length)
        hidden = cv2.dilate(hidden, np.ones((PATCH_SIZE, PATCH_SIZE), np.uint8))
        top = calibration.to_image(np.array([[strip.length / 2, HIGH_HEIGHT]]))[0, 1]
        border = PATCH_SIZE // 2 + SEARCH_RADIUS
        watched = np.zeros(sigma.shape, dtype=bool)
        watched[max(int(top), 0) + border : -border, border:-border] = True
        sigma[~watched | (hidden > 0)] = np.inf
        corners, weights = _choose_patches(sigma)
        soft = _denoised(grey)
        patches = tuple(
            soft[v : v + PATCH_SIZE, u : u + PATCH_SIZE].copy() for u, v in corners
        )
        places = np.array(corners, dtype=np.float64).reshape(-1, 2)
        return cls(places, patches, np.array(weights), calibration)

    def check(self) -> PreflightCheck:
        """Passing check that states whether enough patches are known to notice camera
        motion.
        """
        count = len(self.patches)
        name = CAMERA_WATCHED
        reason = f"{count} static patches are visible, {FEWEST_PATCHES} are needed"
        if count < FEWEST_PATCHES:
            name = UNWATCHED
            reason += ": a camera that is nudged in this fold would not be noticed"
        return PreflightCheck(
            name=name,
            passed=True,
            reason=reason,
            remedy=(
                "put something with a pattern where the strip does not hide it, or"
                " light it better"
            ),
        )

    def shift(self, image: Image, gripper: Pose) -> float:
        """Apparent shift [m] of the scene in `image` (h, w, 3) since the preflight
        image.

        The weighted median over the patches, where most of them agree, so that shadows
        on some do not count; brightness does not either. NaN where too few patches are
        found. `gripper` is the measured pose at the image's stamp.
        """
        shifts = self._find_all(image, gripper)
        visible = np.isfinite(shifts[:, 0])
        if np.count_nonzero(visible) < FEWEST_PATCHES:
            return nan
        shifts = shifts[visible]
        weights = self.weights[visible]
        common = np.quantile(
            shifts, 0.5, axis=0, weights=weights, method="inverted_cdf"
        )
        alike = np.hypot(*(shifts - common).T) <= ALONG
        if (
            np.count_nonzero(alike) < FEWEST_PATCHES
            or 2 * weights[alike].sum() <= weights.sum()
        ):
            return nan
        corner = self.corners[visible][:1]
        to_plane = self.calibration.to_plane
        return float(np.hypot(*(to_plane(corner + common) - to_plane(corner))[0]))

    def _find_all(self, image: Image, gripper: Pose) -> Array:
        """Shifts (n, 2) [px] of the patches in `image`, NaN of those hidden or not
        found.
        """
        clear = without_hand(Region.whole(image), self.calibration, gripper)
        moved = np.full(self.corners.shape, nan)
        for i, (u, v) in enumerate(self.corners.astype(int).tolist()):
            if clear[v : v + PATCH_SIZE, u : u + PATCH_SIZE].all():
                window = image[
                    v - SEARCH_RADIUS : v + PATCH_SIZE + SEARCH_RADIUS,
                    u - SEARCH_RADIUS : u + PATCH_SIZE + SEARCH_RADIUS,
                ]
                moved[i] = _find_shift(_denoised(grey_of(window)), self.patches[i])
        return moved


def _choose_patches(sigma: Array) -> tuple[list[tuple[int, int]], list[float]]:
    """Corners (column, row) [px] and weights of the best patches; overwrites `sigma`
    (h, w).
    """
    corners: list[tuple[int, int]] = []
    weights: list[float] = []
    while len(corners) < MOST_PATCHES and sigma.min() <= PATCH_SIGMA:
        v, u = np.unravel_index(int(sigma.argmin()), sigma.shape)
        corners.append((int(u) - PATCH_SIZE // 2, int(v) - PATCH_SIZE // 2))
        weights.append(sigma[v, u] ** -2)
        rows = slice(max(v - PATCH_SIZE, 0), v + PATCH_SIZE)
        columns = slice(max(u - PATCH_SIZE, 0), u + PATCH_SIZE)
        sigma[rows, columns] = np.inf
    return corners, weights


def _place_deviation(grey: Image, noise: float) -> Array:
    """Standard deviation (h, w) [px] of the measured shift of a patch centred at each
    pixel.

    In its less sure direction; `noise` [grey levels] is that of two pixels' difference.
    """
    grey = grey.astype(np.float32)
    dx = cv2.Scharr(grey, -1, 1, 0, scale=1 / 32)
    dz = cv2.Scharr(grey, -1, 0, 1, scale=1 / 32)
    xx, xz, zz = (
        cv2.boxFilter(product, -1, (PATCH_SIZE, PATCH_SIZE), normalize=False)
        for product in (dx * dx, dx * dz, dz * dz)
    )
    least = (xx + zz) / 2 - np.hypot((xx - zz) / 2, xz)
    flat = np.median(least)  # of noise alone
    spread = noise / np.sqrt(np.maximum(least - flat, 1e-6))
    sigma: Array = spread.astype(np.float64)
    return sigma


def _find_shift(window: Image, patch: Image) -> Array:
    """Shift (2,) [px] of `patch` (n, n) in a `window` SEARCH_RADIUS wider, NaN where
    not found.

    A patch at the window's border may lie outside of it.
    """
    place = find_patch(window, patch)
    if place is None or not ((place >= 0.5) & (place <= 2 * SEARCH_RADIUS - 0.5)).all():
        return np.full(2, nan)
    return place - SEARCH_RADIUS


def _denoised(grey: Image) -> Image:
    """Blurred copy of `grey` (h, w), in which noise is averaged over NOISE_WINDOW."""
    soft: Image = cv2.GaussianBlur(grey, (0, 0), NOISE_WINDOW)
    return soft
