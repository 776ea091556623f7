"""Segmentation of the strip in a scene of any colours: background and palette
learnt at preflight.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.calibration import Calibration
from calibration.perception.background import EVEN, LIFTED_SHADE, Background, background
from calibration.perception.matte import NOISE, SCALE, ZERO
from calibration.perception.palette import palette
from calibration.perception.region import Region, way_of
from calibration.perception.resting import face_height
from drivers.strip.file import StripFile
from drivers.types import Array, Image

CHANGE = 5.0  # grey levels from which a pixel is not the background
SHADE = 0.15  # share of brightness by which the strip's own colour changes as it turns
SENSOR = NOISE * 2**0.5  # grey levels: of the picture and of the background, which is one too
BLIND = 2.0  # separation under which a colour cannot be told from what is behind it

Floats = NDArray[np.float32]
Places = tuple[NDArray[np.intp], NDArray[np.intp]]


@dataclass(frozen=True, slots=True)
class Scenery:
    """Learnt scene: `colours` (k, 3) BGR of the strip, and the `background`.

    `noise` is the standard deviation of a pixel's fraction of strip, from the camera's noise only.
    """

    colours: Array
    background: Background
    noise: float

    def of(self, image: Image, region: Region, visible: Image) -> Image:
        """(h, w) matte levels of `region` of the whole `image` (height, width, 3): ZERO is
        background, ZERO + SCALE strip.

        Pixels masked out by `visible` (h, w) count as background.
        """
        seen = region.of(image)
        light = self.background.light(seen, region, visible)
        behind = region.of(self.background.image)
        changed = _changed(seen, behind, light, visible)
        now = _floats(seen[changed]) / (_floats(light[changed]) / EVEN)[:, None]
        shade = region.of(self.background.shade)[changed]
        share = self._share(now.astype(np.float32), _floats(behind[changed]), shade)
        levels = np.full(seen.shape[:2], ZERO, dtype=np.uint8)
        levels[changed] = np.rint(np.clip(ZERO + SCALE * share, 0, 255))
        return levels

    def separation(self, where: Image) -> Floats:
        """(k, n) distance of each colour from the background in the n pixels of a mask, in standard
        deviations.
        """
        behind, shade = self.background.image[where > 0], self.background.shade[where > 0]
        scene = behind.astype(np.float32)
        reach = [discriminant(colour, scene, shade)[2] for colour in _floats(self.colours)]
        return np.sqrt(np.stack(reach))

    def _share(self, now: Floats, then: Floats, shade: Floats) -> Floats:
        """(n,) of the strip's colours, the share of the one that a pixel shows most of."""
        best = np.zeros(len(now), dtype=np.float32)
        for colour in _floats(self.colours):
            of_strip, of_scene, reach = discriminant(colour, then, shade)
            away = now - then
            along = of_strip * (away @ colour) + of_scene * (away * then).sum(axis=1)
            share = np.where(reach > BLIND**2, along / np.maximum(reach, 1e-6), 0)
            np.maximum(best, share, out=best)
        return best


def learnt(image: Image, strip: Array, calibration: Calibration, stated: StripFile) -> Scenery:
    """The scene and the resting strip in `image` (h, w, 3), the strip's pixels
    being `strip` (n, 3).
    """
    half = stated.thickness / 2
    face = face_height(calibration, stated)
    behind = background(image, calibration, stated.length, (-half, half + face))
    colours = palette(strip)
    way = way_of(calibration, stated.length)
    return Scenery(colours, behind, _noise(colours, behind.image[way > 0]))


def _noise(colours: Array, behind: Image) -> float:
    """Standard deviation of a pixel's fraction of strip before `behind` (n, 3),
    for the worst colour.
    """
    scene = behind.astype(np.float32)
    shade = np.full(len(scene), LIFTED_SHADE, dtype=np.float32)
    worst = 0.0
    for colour in _floats(colours):
        a, b, reach = discriminant(colour, scene, shade)
        size = np.linalg.norm(a[:, None] * colour + b[:, None] * scene, axis=1)
        told = reach > BLIND**2
        if told.any():
            worst = max(worst, float(np.median(size[told] / reach[told])) * SENSOR)
    return worst


def discriminant(colour: Floats, scene: Floats, shade: Floats) -> tuple[Floats, Floats, Floats]:
    """Fisher's discriminant of `colour` (3,) from each background (n, 3), in closed form.

    Its direction is a colour + b scene; returned are a, b (n,) and the squared separation (n,).
    The scatter is noise, SHADE of the strip's brightness and `shade` (n,) of the scene's.
    """
    noise = np.float32(SENSOR**2)
    own, of_own = np.float32(SHADE), float(colour @ colour)
    of_scene, mixed = (scene * scene).sum(axis=1), scene @ colour
    g11, g22, g12 = own**2 * of_own, shade**2 * of_scene, own * shade * mixed
    c1, c2 = 1 / own, -1 / shade
    determinant = (noise + g11) * (noise + g22) - g12**2
    y1 = ((noise + g22) * c1 - g12 * c2) / determinant * own
    y2 = ((noise + g11) * c2 - g12 * c1) / determinant * shade
    reach = y1 * (of_own - mixed) + y2 * (mixed - of_scene)
    return y1, y2, np.maximum(reach, 0)


def _changed(seen: Image, behind: Image, light: Image, visible: Image) -> Places:
    """Bounding rows and columns of visible pixels that differ from the background in this light."""
    expected = cv2.multiply(behind, cv2.merge([light, light, light]), scale=1 / EVEN)
    away = cv2.blur(cv2.absdiff(seen, expected), (3, 3))
    most = cv2.max(cv2.max(away[..., 0], away[..., 1]), away[..., 2])
    places = cv2.findNonZero(cv2.compare(most, CHANGE, cv2.CMP_GE) & visible)
    columns, rows = np.empty((2, 0), np.intp) if places is None else places.reshape(-1, 2).T
    return rows, columns


def _floats(values: Array | Image) -> Floats:
    return np.asarray(values, dtype=np.float32)
