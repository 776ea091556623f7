"""What the images say of a fold agrees with the twin's truth."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from cell.perception.kernels import LEVEL_SPAN, ZERO_LEVEL
from cell.perception.perception import (
    SAMPLE_SPACING,
    Perception,
    SearchLine,
    find_contact,
)
from cell.perception.silhouette import _bridge_regions
from drivers.strip.describe import load_strip
from drivers.twin.settings import CameraSettings
from policies.path import circular, triangular
from tests.lab.studies.kit.sights import perception_of
from tests.lab.studies.kit.twin_fold import FoldCamera, TwinFold, simulate_fold
from tests.support.seen_folds import SPEED, STRIPS, Agreement, agreement, rms
from tests.support.twin_calibration import twin_calibration

CAMERA = CameraSettings()
CASES = [("denim", "triangular"), ("blanket", "circular"), ("tablecloth", "triangular")]


@lru_cache
def _fold(name: str, kind: str) -> TwinFold:
    strip = load_strip(STRIPS / f"{name}.yaml")
    path = {"triangular": triangular, "circular": circular}[kind]
    return simulate_fold(strip, path(strip.length), SPEED)


def _seen(fold: TwinFold, every: int, camera: CameraSettings = CAMERA) -> Agreement:
    """What images say of each `every`-th moment of `fold`, beside its truth."""
    shown = FoldCamera(fold.strip, camera)
    return agreement(fold, shown, twin_calibration(camera), every=every)


@lru_cache
def _agreement(name: str, kind: str) -> Agreement:
    return _seen(_fold(name, kind), 6)


@pytest.mark.parametrize(("share", "confidence"), [(1.0, 1.0), (0.6, 0.6)])
def test_drawn_end_is_found_between_samples_and_a_faint_one_is_unsure(
    share, confidence
) -> None:
    x, levels = (
        np.arange(0.0, 0.3, SAMPLE_SPACING),
        np.full((20, 3000), ZERO_LEVEL, np.uint8),
    )
    levels[5:, :1601] += np.uint8(share * LEVEL_SPAN)  # pixels of 0.1 mm
    line = SearchLine(x, np.column_stack([1e4 * x, 0 * x + 10]), np.zeros((1, 2)))
    found = find_contact(levels, line, np.zeros(2))
    assert found.confidence == pytest.approx(confidence)
    assert share < 1.0 or found.x == pytest.approx(0.16005, abs=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize(
    "camera",
    [
        CameraSettings(yaw=0.02, tilt=0.015, roll=0.03, view_width=0.85),
        CameraSettings(distance=1.2),
        CameraSettings(noise=5.0, light_gradient=0.35),
    ],
    ids=["crooked", "near", "dim"],
)
def test_another_camera_place_or_light_keeps_the_agreement(
    camera: CameraSettings,
) -> None:
    found = _seen(_fold("denim", "triangular"), 24, camera)
    assert rms(found.contact) < 0.0015
    assert found.profile.max() < 0.001
    assert abs(found.lateness) < 0.05
    assert abs(found.displacement) < 0.003


@lru_cache
def _ready() -> tuple[Perception, FoldCamera, TwinFold]:
    fold = _fold("denim", "triangular")
    camera = FoldCamera(fold.strip, CAMERA)
    return perception_of(camera, fold.strip, twin_calibration(CAMERA)), camera, fold


@pytest.mark.slow
@pytest.mark.parametrize(("name", "kind"), CASES)
def test_desk_contact_is_within_1_5_mm_rms(name: str, kind: str) -> None:
    found = _agreement(name, kind)
    assert len(found.contact) > 40
    assert np.isfinite(found.contact).all()
    assert rms(found.contact) < 0.0015


@pytest.mark.slow
def test_a_crease_is_no_desk_contact() -> None:
    """It read the crease in 25 of 33 images, 100 mm from the contact in the median."""
    crease = {"crease": {"angle": -0.549, "position": 0.2565}}
    strip = load_strip(STRIPS / "tablecloth.yaml").model_copy(
        update={"effects": crease}
    )
    fold = simulate_fold(strip, triangular(strip.length), SPEED, links=120)
    found = _seen(fold, 10)
    assert np.median(np.abs(found.contact)) < 0.001
    before = found.t < fold.touch.time - 0.5
    at_crease = np.abs(found.contact[before]) > 0.01  # too little lies beyond it
    assert at_crease.mean() < 0.15


@pytest.mark.parametrize(("name", "kind"), CASES)
def test_profile_is_within_1_mm_rms_in_every_frame(name: str, kind: str) -> None:
    found = _agreement(name, kind)
    assert np.isfinite(found.profile).all()
    assert found.profile.max() < 0.001


@pytest.mark.parametrize(("name", "kind"), CASES)
def test_layer_touch_is_within_50_ms_and_displacement_within_3_mm(
    name: str, kind: str
) -> None:
    found = _agreement(name, kind)
    assert abs(found.lateness) < 0.05
    assert abs(found.displacement) < 0.003
    assert 0 < found.told_after < 0.12
    assert found.touch.confidence > 0.5


@pytest.mark.parametrize("slid", [0.002, 0.006, 0.015])
def test_edge_that_slid_on_the_desk_takes_neither_contact_nor_profile_away(
    slid: float,
) -> None:
    perception, camera, fold = _ready()
    away = np.array([slid, 0.0])
    moved = replace(
        fold, shapes=fold.shapes + away, poses=fold.poses + np.array([slid, 0, 0])
    )
    sight = perception.measure(camera.frame(moved, 200), moved.pose(200 / 60))
    assert sight.contact_x == pytest.approx(fold.contact_x(200 / 60) + slid, abs=0.0015)
    assert sight.contact_confidence > 0.9
    assert abs(sight.profile[0, 0] - sight.contact_x) < 0.004


@pytest.mark.parametrize("level", [0, 90, 255])
def test_blank_image_is_no_sight_and_no_exception(level: int) -> None:
    perception, camera, fold = _ready()
    frame = camera.frame(fold, 200)
    blank = replace(frame, image=np.full_like(frame.image, level))
    sight = perception.measure(blank, fold.pose(200 / 60))
    assert sight.confidence < 0.3


@pytest.mark.parametrize(("longest", "joined"), [(50.0, True), (20.0, False)])
def test_a_gap_in_the_strip_is_bridged_up_to_a_length(longest, joined) -> None:
    mask = np.zeros((20, 80), np.uint8)
    body, other = np.array([[10, 10]]), np.array([[50, 10]])
    grip = np.array([60.0, 10.0])
    assert _bridge_regions(mask, body, [body, other], grip, longest) is joined
