"""Check of one image before grasping: the right strip lies there, flat and well visible."""

from dataclasses import dataclass, replace

import numpy as np

from calibration.calibration import Calibration
from calibration.perception.appearance import Appearance
from calibration.perception.checks import (
    PreflightCheck,
    contrast,
    exposed,
    lies_there,
    rests_well,
    size,
    solid,
    thin_enough,
    told_from_background,
    told_from_desk,
)
from calibration.perception.matte import matte, share, soft
from calibration.perception.palette import palette
from calibration.perception.region import way_of, whole
from calibration.perception.resting import Samples, inner_pixels, resting_line, samples, underside
from calibration.perception.scenery import Scenery, learnt
from calibration.perception.settings import PerceptionSettings
from drivers.strip.file import StripFile
from drivers.types import Frame, Image, frozen

SURE = 7.0  # separation from which one row of numbers tells the strip in any light
ALIKE = 0.15  # share of strip from which something else in the picture looks like it
FEW = 0.001  # share of the background where that may be


@dataclass(frozen=True, slots=True)
class Preflight:
    """All checks of one image, and the colours found; `appearance` is None without a strip."""

    checks: tuple[PreflightCheck, ...]
    appearance: Appearance | None

    @property
    def passed(self) -> bool:
        """Whether every check passed."""
        return self.appearance is not None and all(check.passed for check in self.checks)


def inspect(
    frame: Frame, calibration: Calibration, settings: PerceptionSettings, strip: StripFile
) -> Preflight:
    """Checks of the image `frame` of a strip lying flat on the desk, not yet grasped.

    A uniform strip and scene are described by three colours. Otherwise the background is learnt
    pixel by pixel, and the strip's colours one by one.
    """
    image = frame.image
    refused = [
        check for check in (size(image, calibration), thin_enough(strip)) if not check.passed
    ]
    if refused:
        return Preflight(tuple(refused), None)
    case = _Case(calibration, settings, strip, samples(image, calibration, strip))
    look = matte(*case.seen.colours)
    levels = look.of(image)
    plain = _judged(case, levels, (contrast(look, *case.seen.colours, settings),))
    if plain.appearance is not None:  # it may lie higher or lower than the calibration says
        rise = float(np.median(plain.appearance.rest_height(np.linspace(0.0, strip.length))))
        inner = inner_pixels(image, calibration, strip, rise)
        case = replace(case, seen=replace(case.seen, inner=inner))
    if look.separation >= SURE and _uniform(levels, case):
        return plain
    scenery = learnt(image, case.seen.inner, calibration, strip)
    levels = scenery.of(image, whole(image), np.full(image.shape[:2], 255, np.uint8))
    told = (
        exposed(case.seen),
        told_from_desk(scenery, case.seen.colours[1], settings),
        told_from_background(scenery, calibration, strip),
        solid(soft(levels), calibration, strip),
    )
    better = _judged(case, levels, told, scenery)
    misplaced = plain.appearance is not None and not plain.passed
    return plain if misplaced and not better.passed else better


@dataclass(frozen=True, slots=True)
class _Case:
    """Inputs of the checks of one image, and the pixels sampled from it."""

    calibration: Calibration
    settings: PerceptionSettings
    strip: StripFile
    seen: Samples


def _judged(
    case: _Case, levels: Image, told: tuple[PreflightCheck, ...], scenery: Scenery | None = None
) -> Preflight:
    """The strip by matte `levels` of the whole image, after the checks that it
    is distinguishable.
    """
    lying = underside(soft(levels), case.calibration, case.strip)
    lies = lies_there(lying, case.strip, clear=all(check.passed for check in told))
    if not lies.passed:
        return Preflight((*told, lies), None)
    strip, desk, backdrop = (frozen(colour) for colour in case.seen.colours)
    appearance = Appearance(strip, desk, backdrop, frozen(resting_line(lying)), scenery)
    rests = rests_well(lying, appearance, case.settings, case.strip)
    return Preflight((*told, lies, *rests), appearance)


def _uniform(levels: Image, case: _Case) -> bool:
    """Whether the strip has one colour and nothing behind its motion looks like it.

    `levels` are those of the whole image.
    """
    way = way_of(case.calibration, case.strip.length)
    alike = np.abs(share(soft(levels)[way > 0])) > ALIKE
    return len(palette(case.seen.inner)) == 1 and float(alike.mean()) < FEW
