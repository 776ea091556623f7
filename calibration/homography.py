"""Homography between the undistorted image and the plane of the strip's near edge."""

from dataclasses import dataclass
from typing import Self

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.lens import Lens
from drivers.base.errors import ConfigurationError
from drivers.base.types import Array, frozen

MINIMUM_POINTS = 12
MINIMUM_INLIERS = MINIMUM_POINTS * 3 // 4  # that a map must fit
# of a matrix from pixels to metres, under which it is singular
SMALLEST_DETERMINANT = 1e-18
MAP_PARAMETERS = 8
POSITION_STEP = 1e-5  # m over which a map's derivative is taken
RANSAC_THRESHOLD = 1.5  # px, RANSAC on millimetres to pixels


@dataclass(frozen=True, slots=True)
class Homography:
    """Homography from undistorted pixels to x, z [m], by `matrix` (3, 3), and its
    `inverse`.
    """

    matrix: Array
    inverse: Array

    @classmethod
    def from_matrix(cls, matrix: Array) -> Self:
        """Homography with `matrix` (3, 3), pixels to metres; or ConfigurationError if
        singular.
        """
        scaled = np.asarray(matrix, dtype=np.float64)
        if (
            not np.isfinite(scaled).all()
            or abs(np.linalg.det(scaled)) < SMALLEST_DETERMINANT
        ):
            raise ConfigurationError(
                "homography: the matrix is singular; calibrate again"
            )
        return cls(frozen(scaled), frozen(np.linalg.inv(scaled)))

    def to_plane(self, pixels: Array) -> Array:
        """Points (n, 2) x, z [m] in the plane of the near edge at undistorted `pixels`
        (n, 2).
        """
        return transform(self.matrix, pixels)

    def to_image(self, points: Array) -> Array:
        """Undistorted pixels (n, 2) of `points` (n, 2) x, z [m] in the plane of the
        near edge.
        """
        return transform(self.inverse, points)


@dataclass(frozen=True, slots=True)
class PlaneMap:
    """Map from the camera's raw image to the plane of the strip's near edge: its `lens`
    takes the distortion out, its `homography` maps the rest.
    """

    lens: Lens
    homography: Homography

    def to_plane(self, pixels: Array) -> Array:
        """Points (n, 2) x, z [m] in the near edge's plane of raw image points `pixels`
        (n, 2).
        """
        return self.homography.to_plane(self.lens.undistort(pixels))

    def to_image(self, points: Array) -> Array:
        """Raw image points (n, 2) [px] of `points` (n, 2) x, z [m] in the near edge's
        plane.
        """
        return self.lens.distort(self.homography.to_image(points))


@dataclass(frozen=True, slots=True)
class Viewpoint:
    """Centre of the camera in the cell frame [m]: x, z, and `distance` from the near
    edge's plane.

    Lines along y meet in the image at the picture of (x, z): a curve at depth y appears
    in the plane moved towards (x, z) by the share y / (distance + y).
    """

    x: float
    z: float
    distance: float

    def foot(self) -> Array:
        """Point (2,) x, z [m] of the strip's plane nearest to the camera, where the
        images of lines along y meet.
        """
        return np.array([self.x, self.z])

    def sweep(self, depth: float) -> float:
        """Fraction by which a point `depth` [m] behind the plane appears moved towards
        `foot`.
        """
        return depth / (self.distance + depth)


def fit_homography(
    pixels: Array, points: Array
) -> tuple[Homography, NDArray[np.bool_]]:
    """Fit a homography to undistorted `pixels` (n, 2) of touched `points` (n, 2) x, z
    [m].

    Also returns the mask (n,) of inliers. RANSAC from millimetres to pixels at 1.5 px,
    then a refit to the inliers. Raises ConfigurationError for fewer than twelve points,
    or points that determine no map.
    """
    if len(points) < MINIMUM_POINTS:
        raise ConfigurationError(
            f"homography: {len(points)} touched points, at least {MINIMUM_POINTS} are"
            " needed; touch more"
        )

    to_pixels, mask = cv2.findHomography(
        1e3 * points, pixels, cv2.RANSAC, RANSAC_THRESHOLD
    )
    if to_pixels is None:
        raise ConfigurationError(
            "homography: the touched points determine no map; spread them"
        )

    inliers = np.ravel(mask).astype(bool)
    if inliers.sum() < MINIMUM_INLIERS:
        raise ConfigurationError(
            f"homography: only {inliers.sum()} of {len(points)} touched points agree; "
            "check the pointer and touch again"
        )
    return homography_of(pixels[inliers], points[inliers]), inliers


def homography_of(pixels: Array, points: Array) -> Homography:
    """Homography by least squares from undistorted `pixels` (n, 2) to `points` (n, 2)
    x, z [m]; ConfigurationError for a singular one.
    """
    to_pixels, _ = cv2.findHomography(1e3 * points, pixels, 0)
    to_metres = np.diag([1e-3, 1e-3, 1.0])
    return Homography.from_matrix(to_metres @ np.linalg.inv(to_pixels))


def map_deviation(
    homography: Homography, pixels: Array, points: Array, positions: Array
) -> Array:
    """Standard deviations (k,) [m] of a fitted map at `positions` (k, 2) x, z [m].

    By the covariance of its least squares, which fit the undistorted `pixels` (n, 2) of
    `points` (n, 2) with as much scatter as is left; the lens is taken as exact.
    """
    residuals = pixels - homography.to_image(points)
    variance = (residuals**2).sum() / (residuals.size - MAP_PARAMETERS)
    design = _by_map(homography, points).reshape(-1, MAP_PARAMETERS)
    solution = np.linalg.pinv(design)
    covariance = variance * solution @ solution.T

    here = homography.to_image(positions)
    steps = POSITION_STEP * np.eye(2)
    by_position = [homography.to_image(positions + step) - here for step in steps]
    moved = np.linalg.solve(
        np.stack(by_position, axis=-1) / POSITION_STEP, _by_map(homography, positions)
    )
    largest: Array = np.linalg.eigvalsh(moved @ covariance @ moved.mT)[:, -1]
    return np.sqrt(largest)


def _by_map(homography: Homography, points: Array) -> Array:
    """Derivatives (n, 2, 8) of the pixels of `points` (n, 2) by the eight free entries
    of the homography.
    """
    pixels = homography.to_image(points)
    inverse = homography.inverse / homography.inverse[2, 2]
    lifted = np.insert(points, 2, 1.0, axis=1)
    scaled = lifted / (lifted @ inverse[2])[:, None]
    none = np.zeros_like(scaled)
    across = np.hstack([scaled, none, -pixels[:, :1] * scaled[:, :2]])
    down = np.hstack([none, scaled, -pixels[:, 1:] * scaled[:, :2]])
    return np.stack([across, down], axis=1)


def viewpoint(lens: Lens, homography: Homography) -> Viewpoint:
    """Position of the camera, from lens and homography; ConfigurationError where they
    disagree.
    """
    shares = np.array([(u, v) for u in (0.1, 0.5, 0.9) for v in (0.1, 0.5, 0.9)])
    pixels = shares * lens.size
    plane = homography.to_plane(pixels)
    world = np.column_stack([plane[:, 0], np.zeros(len(plane)), plane[:, 1]])
    solved, rotation, translation = cv2.solvePnP(world, pixels, lens.matrix, None)
    if not solved:
        raise ConfigurationError(
            "homography: lens and map contradict each other; do both again"
        )

    centre = -cv2.Rodrigues(rotation)[0].T @ translation.ravel()
    if not centre[1] < 0:
        raise ConfigurationError(
            "homography: the camera looks from behind; check the y-axis"
        )

    return Viewpoint(float(centre[0]), float(centre[2]), float(-centre[1]))


def transform(matrix: Array, points: Array) -> Array:
    """Images (n, 2) of plane `points` (n, 2) under the projective map with `matrix` (3,
    3).
    """
    flat = np.asarray(points, dtype=np.float64).reshape(-1, 2)
    mapped = flat @ matrix[:, :2].T + matrix[:, 2]
    images: Array = mapped[:, :2] / mapped[:, 2:]
    return images
