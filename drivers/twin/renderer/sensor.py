"""The image sensor: lens blur and pre-drawn noise."""

from dataclasses import dataclass

import cv2
import numpy as np

from drivers.types import Image

TILE_SHIFTS = 200  # px, so many by as many places of the tile under the image


def blur(image: Image, sigma: float) -> Image:
    """`image` (h, w, 3) blurred by a lens with a Gaussian point spread of `sigma` [px]."""
    if sigma == 0:
        return image
    return np.asarray(cv2.GaussianBlur(image, (reach(sigma), reach(sigma)), sigma), dtype=np.uint8)


def reach(sigma: float) -> int:
    """Odd size [px] of the kernel of a Gaussian blur of `sigma` [px]."""
    return 2 * max(1, int(np.ceil(2.6 * sigma))) + 1


def noisy(image: Image, sigma: float, rng: np.random.Generator) -> Image:
    """`image` (h, w, 3) with fresh Gaussian noise of `sigma` grey levels."""
    noise = rng.standard_normal(image.shape, dtype=np.float32) * np.float32(sigma)
    return np.asarray(np.clip(np.rint(image + noise), 0, 255), dtype=np.uint8)


@dataclass(frozen=True, slots=True)
class NoiseBank:
    """A noise tile (height, width, 3) larger than the image, as positive and negative parts."""

    seed: int
    adds: Image
    takes: Image

    def apply(self, image: Image, sequence: int) -> None:
        """Add the noise of frame `sequence` in place; a function of seed and sequence only."""
        rng = np.random.default_rng((self.seed, sequence))
        y, x = rng.integers(TILE_SHIFTS, size=2)
        window = (slice(y, y + image.shape[0]), slice(x, x + image.shape[1]))
        cv2.add(image, self.adds[window], dst=image)
        cv2.subtract(image, self.takes[window], dst=image)


def noise_bank(width: int, height: int, sigma: float, seed: int) -> NoiseBank:
    """Noise bank of `sigma` grey levels, correlated between neighbours as after demosaicing."""
    rng = np.random.default_rng((seed, 0x5E))
    tile = rng.standard_normal((height + TILE_SHIFTS, width + TILE_SHIFTS, 3), dtype=np.float32)
    tile = cv2.GaussianBlur(tile, (3, 3), 0.5)
    tile *= sigma / tile.std()
    return NoiseBank(
        seed,
        adds=np.rint(np.maximum(tile, 0)).astype(np.uint8),
        takes=np.rint(np.maximum(-tile, 0)).astype(np.uint8),
    )
