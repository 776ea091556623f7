"""Check of one image before grasping: the right strip lies there, flat and well visible."""

from dataclasses import dataclass

import numpy as np

from calibration.calibration import Calibration
from cell.perception.appearance import Appearance
from cell.perception.checks import (
    PreflightCheck,
    background_contrast,
    check_exposure,
    desk_contrast,
    lies_there,
    rests_well,
    size,
    solid,
    thin_enough,
)
from cell.perception.levels import ZERO_LEVEL, soft
from cell.perception.region import Region
from cell.perception.resting import inner_pixels, resting_line, samples, underside
from cell.perception.segmenter import Segmenter, learn, resting_place, sensor_noise
from cell.perception.settings import PerceptionSettings
from drivers.strip.file import StripFile
from drivers.types import Frame, Image, frozen

MARGINS = (0.005, 0.002)  # m about the resting strip: before its height is known, then its blur


@dataclass(frozen=True, slots=True)
class Preflight:
    """Checks of one image, and the `appearance` learnt from it, None where no strip is seen."""

    checks: tuple[PreflightCheck, ...]
    appearance: Appearance | None

    @property
    def passed(self) -> bool:
        """Whether every check passed."""
        return self.appearance is not None and all(check.passed for check in self.checks)


def inspect(
    frame: Frame, calibration: Calibration, settings: PerceptionSettings, strip: StripFile
) -> Preflight:
    """Check the image `frame` of a strip that lies flat on the desk, not yet grasped.

    The background is learnt pixel by pixel, and the strip's colours one by one: twice, since where
    it rests follows from the first.
    """
    image = frame.image
    refused = [
        check for check in (size(image, calibration), thin_enough(strip)) if not check.passed
    ]
    if refused:
        return Preflight(tuple(refused), None)
    rise, noise = 0.0, sensor_noise(image)
    for margin in MARGINS:
        place = resting_place(calibration, strip, rise, margin)
        inner = inner_pixels(image, calibration, strip, rise)
        scene = learn(image, noise, inner, calibration, strip, place)
        levels = soft(_levels(scene, image))
        lying = underside(levels, calibration, strip)
        rise = float(np.median(lying.z[lying.present])) if lying.present.any() else rise
    seen = samples(image, calibration, strip)
    distinct = (
        check_exposure(seen),
        desk_contrast(scene, seen.desk_colour, settings),
        background_contrast(scene, calibration, strip),
        solid(levels, calibration, strip, max(rise, 0.0)),
    )
    lies = lies_there(lying, strip, clear=all(check.passed for check in distinct))
    if not lies.passed:
        return Preflight((*distinct, lies), None)
    appearance = Appearance(scene, frozen(resting_line(lying)))
    return Preflight((*distinct, lies, *rests_well(lying, appearance, settings, strip)), appearance)


def _levels(scene: Segmenter, image: Image) -> Image:
    """Matte levels (h, w) of the whole `image` (h, w, 3), where no hand hides the strip."""
    h, w = image.shape[:2]
    levels, everywhere = np.full((h, w), ZERO_LEVEL, np.uint8), np.full((h, w), 255, np.uint8)
    part, region = scene.levels(image, Region(0, 0, w, h), everywhere)
    region.of(levels)[:] = part
    return levels
