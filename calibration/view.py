"""View of a camera pinned in one image, by which a later image tells how far the camera
has moved.
"""

from base64 import b64decode, b64encode
from dataclasses import dataclass
from math import hypot, pi
from typing import Self

import cv2
import numpy as np
from pydantic import Field

from calibration.homography import PlaneMap
from drivers.base.geometry import lengths
from drivers.base.readers import picture_of
from drivers.base.settings import Settings
from drivers.base.types import Array, Image, Pose, frozen

PATCH_SIZE = 32  # px
MOST_PATCHES = 120
SEARCH_RADIUS = 40  # px about its place in which a patch is searched
REFINED_RADIUS = 3  # px likewise, once the motion is known by and large
MATCH_CORRELATION = 0.6  # correlation from which a patch counts as found
NOISE_WINDOW = 1.5  # px over which noise is averaged
NOISE_AREA = 4 * pi * NOISE_WINDOW**2  # px that differ together then
PATCH_SIGMA = 0.3  # px to which a patch must show its place along one direction
# px, and of the shift, that a patch is off besides: pixels; depth, which moves what is
# near by more than what is far
MODEL_SIGMA, DEPTH_SHARE = 0.12, 0.1
# px at the image's border, turn and zoom that are assumed where nothing shows them
TURN_SIGMA = 0.25
# standard deviations from which a patch disagrees, from coarse to fine
TOLERANCES = (12.0, 6.0, 3.0, 3.0, 3.0)
JPEG_QUALITY = 95
GRID = np.array([(x, y) for y in (0.1, 0.5, 0.9) for x in (0.1, 0.5, 0.9)])  # shares


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


class Landmarks(Settings):
    """Picture of the cell, and the gripper's pose at which it was taken; `jpeg` is
    base64.
    """

    x: float
    z: float
    pitch: float
    jpeg: str

    @classmethod
    def take(cls, image: Image, pose: Pose) -> Self:
        """Landmarks of the `image` (h, w, 3) of the empty hand at rest at `pose`."""
        quality = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
        _, content = cv2.imencode(".jpg", _denoised(image), quality)
        return cls(
            x=pose.x,
            z=pose.z,
            pitch=pose.pitch,
            jpeg=b64encode(bytes(content)).decode("ascii"),
        )

    @property
    def pose(self) -> Pose:
        """Pose of the gripper at which the landmarks were taken."""
        return Pose(self.x, self.z, self.pitch)

    def picture(self) -> Image:
        """The picture (h, w, 3); ConfigurationError where it cannot be read."""
        try:
            content = b64decode(self.jpeg, validate=True)
        except ValueError:
            content = b""
        return picture_of(content, "landmarks: jpeg")


@dataclass(frozen=True, slots=True)
class ImageMotion:
    """Motion of a view in the image: how all that stands still moved, turned and grew.

    `parameters` (4,) are the shift u, v [px] of the image's middle, and growth and turn
    as px at half its width; `size` is its width and height [px]. The patches at
    `positions` (n, 2) agree on it.
    """

    parameters: Array
    size: tuple[int, int]
    positions: Array

    def shift(self, positions: Array) -> Array:
        """Shifts (n, 2) [px] of what was at the pixels `positions` (n, 2)."""
        shifts: Array = _design(positions, self.size) @ self.parameters
        return shifts

    def largest(self) -> float:
        """Largest shift [px] over the image."""
        return float(lengths(self.shift(GRID * self.size)).max())

    def in_plane(self, positions: Array, plane_map: PlaneMap) -> Array:
        """Shifts (n, 2) x, z [m] in the near edge's plane of the points at
        `positions`.
        """
        moved = positions + self.shift(positions)
        return plane_map.to_plane(moved) - plane_map.to_plane(positions)

    def largest_in_plane(self, plane_map: PlaneMap) -> float:
        """Largest shift [m] in the near edge's plane over the image."""
        return float(lengths(self.in_plane(GRID * self.size, plane_map)).max())


@dataclass(frozen=True, slots=True)
class PinnedView:
    """Patches of one image of a scene that stands still, to be found in later ones.

    `corners` (n, 2) are column and row [px] of their first pixels, `patches` their grey
    levels (n, PATCH_SIZE, PATCH_SIZE), `tensors` (n, 2, 2) their structure, which is
    singular for an edge. `size` is the image's width and height [px].
    """

    corners: Array
    patches: Array
    tensors: Array
    size: tuple[int, int]

    @classmethod
    def choose(
        cls, image: Image, where: Image | None = None, most: int = MOST_PATCHES
    ) -> Self:
        """Choose the `most` patches of `image` (h, w, 3) that show their place best,
        within the mask `where` (h, w), if given.

        Half of them by contrast across, half by contrast down.
        """
        shape = image.shape
        tensor, noise = _structure(image)
        allowed = np.full(shape[:2], 255, np.uint8) if where is None else where
        kernel = np.ones((PATCH_SIZE, PATCH_SIZE), np.uint8)
        allowed = cv2.erode(allowed, kernel, borderValue=0)
        least = (noise / PATCH_SIGMA) ** 2
        corners = _choose_corners(tensor, allowed > 0, least, most // 2)
        soft = _denoised(image)
        half = PATCH_SIZE // 2
        return cls(
            corners=frozen(np.array(corners, np.float64).reshape(-1, 2)),
            patches=np.array(
                [soft[v : v + PATCH_SIZE, u : u + PATCH_SIZE] for u, v in corners]
            ).reshape(-1, PATCH_SIZE, PATCH_SIZE),
            tensors=np.array([tensor[v + half, u + half] for u, v in corners]).reshape(
                -1, 2, 2
            ),
            size=(shape[1], shape[0]),
        )

    def motion(
        self,
        image: Image,
        clear: Image | None = None,
        radius: int = SEARCH_RADIUS,
    ) -> ImageMotion | None:
        """Motion of the scene up to `image` (h, w, 3), of up to `radius` [px]; None
        where fewer than two patches agree on it in any direction.

        Patches that are not within the mask `clear` (h, w) are hidden. Most of what is
        found decides: what moves by itself, as a hand, its shadow or a strip, does not
        count, nor does brightness.
        """
        motion = None
        predicted = np.zeros_like(self.corners)
        for reach in (radius, REFINED_RADIUS):
            shifts, scores = self._find(image, clear, np.rint(predicted), reach)
            found = scores > 0
            positions = self.corners[found] + PATCH_SIZE / 2
            shifts = shifts[found]
            scores = scores[found]
            slack = _slack(shifts)
            weights = _weights(self.patches[found], self.tensors[found], scores, slack)
            motion = _common_motion(positions, self.size, shifts, weights, slack)
            if motion is None:
                return None

            predicted = motion.shift(self.corners)
        return motion

    def _find(
        self, image: Image, clear: Image | None, predicted: Array, radius: int
    ) -> tuple[Array, Array]:
        """Shifts (n, 2) [px] of the patches in `image`, within `radius` of those
        `predicted` (n, 2), and their correlations (n,), 0 where hidden or not found.
        """
        shifts = np.zeros_like(self.corners)
        scores = np.zeros(len(shifts))
        first = (self.corners + predicted).astype(int)
        for i, (u, v) in enumerate(first.tolist()):
            left = max(u - radius, 0)
            top = max(v - radius, 0)
            right = u + PATCH_SIZE + radius
            bottom = v + PATCH_SIZE + radius
            window = image[top : max(bottom, 0), left : max(right, 0)]
            if min(window.shape[:2]) < PATCH_SIZE:
                continue
            if (
                clear is not None
                and not clear[
                    max(v, 0) : v + PATCH_SIZE, max(u, 0) : u + PATCH_SIZE
                ].all()
            ):
                continue

            position, score = _find_patch(_denoised(window), self.patches[i])
            if score >= MATCH_CORRELATION:
                shifts[i] = position - self.corners[i] + np.array([left, top])
                scores[i] = score

        return shifts, scores


def _slack(shifts: Array) -> float:
    """Expected standard deviation [px] of a patch's position from a motion common to
    all, by their `shifts` (n, 2) [px].
    """
    if len(shifts) == 0:
        return MODEL_SIGMA
    typical = float(np.median(lengths(shifts)))
    return hypot(MODEL_SIGMA, DEPTH_SHARE * typical)


def _weights(patches: Array, tensors: Array, scores: Array, slack: float) -> Array:
    """Inverse covariances (n, 2, 2) [1/px^2] of the places at which `patches` were
    found with the correlations `scores` (n,).
    """
    differing = np.var(patches, axis=(1, 2)) * (1 - np.minimum(scores, 1) ** 2)
    values, axes = np.linalg.eigh(tensors)
    blurred = NOISE_AREA * differing[:, None] / np.maximum(values, 1e-6)
    weights: Array = axes / (blurred + slack**2)[:, None] @ axes.mT
    return weights


def _denoised(image: Image) -> Image:
    """Grey levels (h, w) of `image` (h, w, 3), noise averaged over NOISE_WINDOW."""
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    soft: Image = cv2.GaussianBlur(grey, (0, 0), NOISE_WINDOW)
    return soft


def _structure(image: Image) -> tuple[Array, float]:
    """Structure tensors (h, w, 2, 2) of patches about each pixel, summed, less those of
    noise, and the noise [grey levels] of the difference of two images.
    """
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY).astype(np.float32)
    cross = grey[1:, 1:] - grey[1:, :-1] - grey[:-1, 1:] + grey[:-1, :-1]
    noise = 2**0.5 * max(1.48 * float(np.median(np.abs(cross))) / 2, 0.5)

    soft = cv2.GaussianBlur(grey, (0, 0), NOISE_WINDOW)
    du = cv2.Scharr(soft, -1, 1, 0, scale=1 / 32)
    dv = cv2.Scharr(soft, -1, 0, 1, scale=1 / 32)
    products = np.stack([du * du, du * dv, dv * dv], axis=-1)
    sums = cv2.boxFilter(products, -1, (PATCH_SIZE, PATCH_SIZE), normalize=False)
    flat = np.median(sums[..., 0] + sums[..., 2]) / 2  # of noise alone
    tensor = sums[..., [0, 1, 1, 2]] - flat * np.array([1, 0, 0, 1])
    return tensor.reshape(*grey.shape, 2, 2), noise


def _choose_corners(
    tensor: Array, allowed: Array, least: float, count: int
) -> list[tuple[int, int]]:
    """Corners (column, row) [px] of `count` patches with most structure across and as
    many down, apart, `allowed` (h, w) and above `least`; overwrites `allowed`.
    """
    corners: list[tuple[int, int]] = []
    half = PATCH_SIZE // 2
    for axis in (0, 1):
        strength = np.where(allowed, tensor[..., axis, axis], 0.0)
        for _ in range(count):
            v, u = np.unravel_index(int(strength.argmax()), strength.shape)
            if strength[v, u] <= least:
                break
            corners.append((int(u) - half, int(v) - half))
            rows = slice(max(v - PATCH_SIZE, 0), v + PATCH_SIZE)
            columns = slice(max(u - PATCH_SIZE, 0), u + PATCH_SIZE)
            strength[rows, columns] = 0.0
            allowed[rows, columns] = False
    return corners


def _find_patch(window: Image, patch: Image) -> tuple[Array, float]:
    """Top left corner (2,) u, v [px] of `patch` (n, n) in the grey `window` (h, w) and
    their correlation, 0 where it has no contrast by which it could be found.
    """
    scores = cv2.matchTemplate(window, patch, cv2.TM_CCOEFF_NORMED)
    _, best, _, (u, v) = cv2.minMaxLoc(scores)
    position = np.array([u + _peak(scores[v, :], u), v + _peak(scores[:, u], v)])
    return position, best if np.ptp(patch) else 0.0


def _peak(scores: Array, at: int) -> float:
    """Offset [indices] of the peak of `scores` (n,) from `at`, by a parabola through 3
    values.
    """
    if not 0 < at < len(scores) - 1:
        return 0.0
    before, peak, after = scores[at - 1 : at + 2].astype(float).tolist()
    bend = before - 2 * peak + after
    return 0.0 if bend >= 0 else 0.5 * (before - after) / bend


def _design(positions: Array, size: tuple[int, int]) -> Array:
    """Derivatives (n, 2, 4) of the shifts at `positions` (n, 2) [px] by the parameters
    of a motion.
    """
    x, y = (2.0 * (positions - np.array(size) / 2) / size[0]).T
    one = np.ones_like(x)
    none = np.zeros_like(x)
    design: Array = np.stack([[one, none, x, -y], [none, one, y, x]])
    return np.moveaxis(design, 2, 0)


def _common_motion(
    positions: Array,
    size: tuple[int, int],
    shifts: Array,
    weights: Array,
    slack: float,
) -> ImageMotion | None:
    """Motion on which most of the `shifts` (n, 2) [px] agree, by iterated weights.

    It begins with the shift of the patch that most others agree with. None where it is
    not known within `slack` [px] at any patch, which takes two.
    """
    if len(shifts) == 0:
        return None
    design = _design(positions, size)
    between = shifts[:, None] - shifts
    misfits = np.einsum("ijk,ikl,ijl->ij", between, weights, between)
    begin = np.minimum(misfits, TOLERANCES[0] ** 2).sum(axis=0).argmin()

    parameters = np.array([*shifts[begin], 0.0, 0.0])
    assumed = np.diag([0.0, 0.0, TURN_SIGMA**-2, TURN_SIGMA**-2])
    for tolerance in TOLERANCES:
        misfit = _misfit(shifts - design @ parameters, weights)
        trust = (1 + misfit / tolerance**2) ** -2.0
        pulls = np.einsum("i,ija,ijk->iak", trust, design, weights)
        information = np.einsum("iak,ikb->ab", pulls, design) + assumed
        if np.linalg.cond(information) > 1e9:
            return None
        parameters = np.linalg.solve(information, np.einsum("iak,ik->a", pulls, shifts))
    covariance = design @ np.linalg.inv(information) @ design.transpose(0, 2, 1)
    agreeing = _misfit(shifts - design @ parameters, weights) < TOLERANCES[-1] ** 2
    variances = np.linalg.eigvalsh(covariance)[agreeing, -1]
    if variances.min(initial=np.inf) > slack**2:
        return None
    return ImageMotion(parameters, size, positions[agreeing])


def _misfit(residuals: Array, weights: Array) -> Array:
    """Squared lengths (n,) of the patches' `residuals` (n, 2) in standard
    deviations.
    """
    squares: Array = np.einsum("ij,ijk,ik->i", residuals, weights, residuals)
    return squares
