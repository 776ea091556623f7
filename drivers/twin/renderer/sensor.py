"""The image sensor: lens blur and a bank of noise drawn once."""

from dataclasses import dataclass

import cv2
import numpy as np

from drivers.types import Image

SHIFT = 160  # px by which a tile can be moved under the image
TILES = 2


def blurred(image: Image, sigma: float) -> Image:
    """`image` through a lens whose point spread has `sigma` [px]."""
    if sigma == 0:
        return image
    return np.asarray(cv2.GaussianBlur(image, (reach(sigma), reach(sigma)), sigma), dtype=np.uint8)


def reach(sigma: float) -> int:
    """Odd size [px] of the kernel that holds a blur of `sigma`."""
    return 2 * max(1, int(np.ceil(2.6 * sigma))) + 1


def noisy(image: Image, sigma: float, rng: np.random.Generator) -> Image:
    """`image` with noise of `sigma` grey levels, drawn afresh."""
    noise = rng.standard_normal(image.shape, dtype=np.float32) * np.float32(sigma)
    return np.asarray(np.clip(np.rint(image + noise), 0, 255), dtype=np.uint8)


@dataclass(frozen=True, slots=True)
class NoiseBank:
    """Tiles larger than the image, (k, height, width, 3): what noise adds and what it takes."""

    seed: int
    adds: tuple[Image, ...]
    takes: tuple[Image, ...]

    def apply(self, image: Image, sequence: int) -> None:
        """Add the noise of frame `sequence` in place; a function of seed and sequence only."""
        if not self.adds:
            return
        rng = np.random.default_rng((self.seed, sequence))
        tile, y, x = rng.integers((len(self.adds), SHIFT, SHIFT))
        window = (slice(y, y + image.shape[0]), slice(x, x + image.shape[1]))
        cv2.add(image, self.adds[tile][window], dst=image)
        cv2.subtract(image, self.takes[tile][window], dst=image)


def noise_bank(width: int, height: int, sigma: float, seed: int) -> NoiseBank:
    """Noise of `sigma` grey levels, in part shared by neighbours, as after demosaicing."""
    if sigma == 0:
        return NoiseBank(seed, (), ())
    rng = np.random.default_rng((seed, 0x5E))
    adds, takes = [], []
    for _ in range(TILES):
        tile = rng.standard_normal((height + SHIFT, width + SHIFT, 3), dtype=np.float32)
        tile = cv2.GaussianBlur(tile, (3, 3), 0.5)
        rounded = np.rint(tile * (sigma / tile.std()))
        adds.append(np.maximum(rounded, 0).astype(np.uint8))
        takes.append(np.maximum(-rounded, 0).astype(np.uint8))
    return NoiseBank(seed, tuple(adds), tuple(takes))
