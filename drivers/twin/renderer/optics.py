"""True model of the twin's camera: a pinhole with radial distortion, and its sensor's
noise.

Private to the twin: calibration uses only images.
"""

from dataclasses import dataclass
from typing import NamedTuple, Self

import cv2
import numpy as np
from numpy.polynomial.polynomial import polyfit
from numpy.typing import NDArray

from drivers.base.types import Array, Image
from drivers.twin.settings import CameraSettings

Pixels = NDArray[np.float32]
TILE_SHIFTS = 200  # px, so many by as many places of the noise tile under the image
FIELD = 0.6  # of the image's diagonal, the radius up to which the lens is inverted


class Optics(NamedTuple):
    """Pinhole camera: `centre` (3,) [m], `rotation` (3, 3), focal length and principal
    point [px].

    `inverse` (5,) are coefficients of the undistorting factor in powers of the squared
    distorted radius.
    """

    centre: Array
    rotation: Array
    focal: float
    principal: tuple[float, float]
    distortion: tuple[float, float]
    inverse: Array

    @classmethod
    def from_settings(cls, settings: CameraSettings) -> Self:
        """Pinhole camera at the position and with the lens and mounting errors of
        `settings`.
        """
        height = settings.distance * np.tan(settings.elevation)
        centre = np.array([settings.aim_x, -settings.distance, height])
        aim = np.array([settings.aim_x, 0.0, settings.aim_z]) - centre
        forward = aim / np.linalg.norm(aim)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        looking = np.stack([right, np.cross(forward, right), forward])
        about_x, about_y, about_z = axis_rotations(
            settings.tilt, settings.yaw, settings.roll
        )
        diagonal = float(np.hypot(settings.width, settings.height))
        principal = (
            (settings.width - 1) / 2 + settings.principal[0],
            (settings.height - 1) / 2 + settings.principal[1],
        )
        return cls(
            centre=centre,
            rotation=about_z @ about_x @ about_y @ looking,
            focal=settings.focal,
            principal=principal,
            distortion=settings.distortion,
            inverse=_inverse(settings.distortion, FIELD * diagonal / settings.focal),
        )

    def displace(self, scale: float, shift: tuple[float, float]) -> Self:
        """Camera moved so that a point p appears where (1 + scale) p + `shift` appeared
        before.

        `shift` is of x, z [m]. All rays turn about the centre, so this holds at every
        depth.
        """
        centre = (self.centre - (shift[0], 0.0, shift[1])) / (1.0 + scale)
        return self._replace(centre=centre)

    def project(self, points: Array) -> Array:
        """Pixels (..., 2) of `points` (..., 3) [m] of the cell frame.

        By Brown's radial law: a ray at the tangents (a, b) of its angles to the optical
        axis, r^2 = a^2 + b^2, appears where one at (1 + k1 r^2 + k2 r^4) (a, b) would.
        """
        seen = (points - self.centre) @ self.rotation.T
        right, down, forward = np.moveaxis(seen, -1, 0)
        a = right / forward
        b = down / forward
        k1, k2 = self.distortion
        r2 = a * a + b * b
        scale = (1 + r2 * (k1 + k2 * r2)) * self.focal
        u, v = self.principal
        return np.stack([a * scale + u, b * scale + v], axis=-1)

    def plane(self, points: Array, y: float = 0.0) -> Array:
        """Pixels (..., 2) of `points` (..., 2) of x, z [m] in the plane at `y` [m]."""
        return self.project(np.insert(points, 1, y, axis=-1))

    def seen_from(self, origin: tuple[int, int]) -> Self:
        """Copy of the camera whose pixels are counted from `origin` (u, v)."""
        u, v = self.principal
        return self._replace(principal=(u - origin[0], v - origin[1]))

    def rays(self, u: Pixels, v: Pixels) -> tuple[Pixels, Pixels, Pixels]:
        """Directions x, y, z (...,) in the cell frame of rays through pixels `u`, `v`
        (...,) [px].

        The lens's distortion is undone. Of length 1 along the optical axis, so not unit
        vectors.
        """
        right = (u - self.principal[0]) / self.focal
        down = (v - self.principal[1]) / self.focal
        squared_radius = right * right + down * down

        undistorting = np.zeros_like(squared_radius)
        for coefficient in self.inverse[::-1].tolist():
            undistorting = undistorting * squared_radius + coefficient
        right = right * undistorting
        down = down * undistorting

        columns = self.rotation.T.tolist()
        x, y, z = (right * a + down * b + c for a, b, c in columns)
        return x, y, z

    def on_level(
        self, rays: tuple[Pixels, Pixels, Pixels], z: float
    ) -> tuple[Pixels, Pixels]:
        """Coordinates x and y [m] at which `rays`, three arrays of x, y and z, meet the
        level `z` [m]; rays not downward end far away.
        """
        centre = self.centre
        right, ahead, up = rays
        reach = float(z - centre[2]) / np.minimum(up, -1e-4)
        x = (centre[0] + reach * right).astype(np.float32)
        y = (centre[1] + reach * ahead).astype(np.float32)
        return x, y


def axis_rotations(x: float, y: float, z: float) -> tuple[Array, Array, Array]:
    """Rotation matrices (3, 3): one by `x` about the x-axis, one by `y` about the
    y-axis, one by `z` [rad] about the z-axis.
    """
    about_x, about_y, about_z = (cv2.Rodrigues(turn)[0] for turn in np.diag([x, y, z]))
    return about_x, about_y, about_z


def _inverse(distortion: tuple[float, float], field: float) -> Array:
    """Coefficients (5,) of the factor that undoes the lens's distortion, in powers of
    the squared distorted radius, fitted up to the radius `field`.
    """
    k1, k2 = distortion
    radius = np.linspace(0.0, field, 400)
    factor = 1 + radius**2 * (k1 + k2 * radius**2)
    return np.asarray(polyfit((radius * factor) ** 2, 1 / factor, 4))


def blur(image: Image, sigma: float) -> Image:
    """Copy of `image` (h, w, 3) blurred by a Gaussian point spread of `sigma` [px]."""
    if sigma == 0:
        return image
    size = kernel_size(sigma)
    blurred: Image = cv2.GaussianBlur(image, (size, size), sigma)
    return blurred


def kernel_size(sigma: float) -> int:
    """Odd size [px] of the kernel of a Gaussian blur of `sigma` [px]."""
    return 2 * max(1, int(np.ceil(2.6 * sigma))) + 1


def noisy(image: Image, sigma: float, rng: np.random.Generator) -> Image:
    """Copy of `image` (h, w, 3) with Gaussian noise of `sigma` grey levels from
    `rng`.
    """
    noise = rng.standard_normal(image.shape, dtype=np.float32) * sigma
    return np.clip(np.rint(image + noise), 0, 255).astype(np.uint8)


@dataclass(frozen=True, slots=True)
class NoiseBank:
    """Tile of image noise (height, width, 3) larger than a frame, split into what it
    adds and what it takes away.
    """

    seed: int
    adds: Image
    takes: Image

    def apply(self, image: Image, sequence: int) -> None:
        """Add the noise of frame number `sequence` to `image` (height, width, 3) in
        place; seed and number alone determine it.
        """
        rng = np.random.default_rng((self.seed, sequence))
        y, x = rng.integers(TILE_SHIFTS, size=2)
        window = (slice(y, y + image.shape[0]), slice(x, x + image.shape[1]))
        cv2.add(image, self.adds[window], dst=image)
        cv2.subtract(image, self.takes[window], dst=image)


def noise_bank(width: int, height: int, sigma: float, seed: int) -> NoiseBank:
    """Draw a noise tile of `sigma` grey levels for frames of `width` x `height` pixels,
    correlated in space as after demosaicing.
    """
    rng = np.random.default_rng((seed, 0x5E))
    tile = rng.standard_normal(
        (height + TILE_SHIFTS, width + TILE_SHIFTS, 3), dtype=np.float32
    )
    tile = cv2.GaussianBlur(tile, (3, 3), 0.5)
    tile *= sigma / tile.std()
    return NoiseBank(
        seed,
        adds=np.rint(np.maximum(tile, 0)).astype(np.uint8),
        takes=np.rint(np.maximum(-tile, 0)).astype(np.uint8),
    )
