"""What preflight admits in any look of the cell agrees with the truth; the rest is
refused.
"""

import re
from functools import lru_cache

import numpy as np
import pytest

from calibration.board import find_pointer
from cell.perception.preflight import Preflight, inspect
from drivers.base.types import Pose
from drivers.strip.describe import load_strip
from drivers.strip.file import StripFile
from drivers.twin.renderer.looks import LOOKS, Box, Look
from drivers.twin.renderer.optics import Optics
from drivers.twin.renderer.renderer import Renderer
from drivers.twin.settings import CameraSettings
from policies.path import triangular
from tests.lab.studies.kit.sights import perception_of
from tests.lab.studies.kit.twin_fold import FoldCamera, TwinFold, simulate_fold
from tests.support.seen_folds import STRIPS, distances
from tests.support.twin_calibration import NO_STRIP, pointer_frame, twin_calibration

CAMERA = CameraSettings()
FRAMES = (120, 200, 290)


@lru_cache
def _strip(name: str) -> StripFile:
    return load_strip(STRIPS / f"{name}.yaml")


@lru_cache
def _fold(strip: str) -> TwinFold:
    stated = _strip(strip)
    return simulate_fold(stated, triangular(stated.length), 0.1)


def _judged(
    look: Look, strip: StripFile, settings: CameraSettings = CAMERA
) -> Preflight:
    flat = FoldCamera(strip, settings, look=look).flat(strip)
    return inspect(flat, twin_calibration(CAMERA), strip)


def _refusals(judged: Preflight) -> dict[str, str]:
    return {check.name: check.reason for check in judged.checks if not check.passed}


@pytest.mark.parametrize(
    ("look", "strip"),
    [
        ("grey-desk", "tablecloth"),
        ("clutter", "interlock"),
        ("flicker", "denim"),
        ("two-colours", "denim"),
        ("checks", "denim"),
        ("stripes", "interlock"),
        ("workshop", "tablecloth"),
    ],
)
def test_strip_that_preflight_admits_is_read_as_it_is(look: str, strip: str) -> None:
    fold = _fold(strip)
    camera = FoldCamera(fold.strip, CAMERA, look=LOOKS[look])
    perception = perception_of(camera, fold.strip, twin_calibration(CAMERA))
    for sequence in FRAMES:
        stamp = sequence / CAMERA.rate
        seen = perception.measure(camera.frame(fold, sequence), fold.pose(stamp))
        assert seen.contact_x == pytest.approx(fold.contact_x(stamp), abs=0.003)
        assert seen.confidence > 0.6
        off = distances(seen.profile, fold.shape(stamp))
        assert np.sqrt(np.mean(off**2)) < 0.0006


@pytest.mark.parametrize(
    ("look", "strip", "check", "reason"),
    [
        ("grey-desk", "interlock", "contrast", "as a desk and its shadow do"),
        ("dark-on-dark", "tablecloth", "contrast", "grey levels"),
        ("white-checks", "denim", "solid", "stands out from the desk"),
    ],
)
def test_look_in_which_a_strip_cannot_be_read_is_refused_and_says_what_to_do(
    look: str, strip: str, check: str, reason: str
) -> None:
    judged = _judged(LOOKS[look], _strip(strip))
    assert reason in _refusals(judged)[check]
    assert all(each.remedy for each in judged.checks)


def test_thing_of_the_strips_colour_behind_its_way_is_refused_with_its_place() -> None:
    room = LOOKS["grey-desk"].colours
    box = Box(low=(0.25, 0.15, 0.0), high=(0.40, 0.2, 0.2), colour=(38, 58, 108))
    judged = _judged(Look(colours=room, things=(box,)), _strip("denim"))
    reason = _refusals(judged)["background"]
    x, z = map(float, re.findall(r"= (\d+) mm", reason))
    assert 230 < x < 400
    assert 10 < z < 200


def test_pin_of_the_calibration_is_found_in_shadow_and_flicker() -> None:
    renderer = Renderer(CAMERA, NO_STRIP, 0, surround=LOOKS["workshop"])
    optics = Optics.from_settings(CAMERA)
    for x, z in ((0.1, 0.05), (0.3, 0.2), (0.4, 0.12), (0.55, 0.1)):
        pose = Pose(x, z, np.pi / 2)
        found = find_pointer(pointer_frame(renderer, pose, 0).image)
        assert found == pytest.approx(optics.plane(np.array([[x, z]]))[0], abs=0.3)
