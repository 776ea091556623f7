"""Images of a camera or a desk that moved: seen as stated, and right once the cell knows it."""

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from cell.devices.rig_correction import correct_calibration
from drivers.strip.describe import describe, load_strip
from drivers.strip.model import StripModel
from drivers.strip.observation import seen_contact, seen_points
from drivers.twin.camera import displaced_optics
from drivers.twin.renderer.looks import StripLook
from drivers.twin.renderer.renderer import Renderer
from drivers.twin.settings import CameraSettings
from drivers.types import Array
from policies.path import triangular
from tests.lab.studies.kit.twin_fold import FoldCamera, TwinFold, simulate_fold
from tests.support.seen_folds import distances, perception_of
from tests.support.twin_calibration import twin_calibration

CONFIGS = Path(__file__).parents[3] / "configs"
DENIM = load_strip(CONFIGS / "strips" / "denim.yaml")
CAMERA = CameraSettings()
Values = Mapping[str, float]
SEEN: list[tuple[str, Values]] = [
    ("homography_scale", {"scale": 0.008}),
    ("homography_shift", {"x": -0.004, "z": 0.0012}),
    ("desk_height", {"height": 0.0014}),
    ("contact_bias", {"bias": 0.004}),
    ("contact_bias", {"bias": -0.003}),
]
FRAMES = (120, 200, 290)


@lru_cache
def _fold() -> TwinFold:
    return simulate_fold(DENIM, triangular(DENIM.length), 0.1, links=120)


def _model(name: str, values: Values) -> StripModel:
    return describe(DENIM, {name: values})


class AffectedCamera(FoldCamera):
    """The camera as it stands since something happened to it."""

    def __init__(self, model: StripModel) -> None:
        optics = displaced_optics(CAMERA, model.observation, model.rig.desk_height)
        super().__init__(DENIM, CAMERA)
        self.renderer = Renderer(
            CAMERA, StripLook.of(DENIM), 0, optics, model.observation.contact_bias
        )


def _looks(model: StripModel, believed: StripModel) -> tuple[Array, list[Array]]:
    """contact_x (k,) and profiles that a cell sees of `model` which believes `believed`."""
    fold, camera = _fold(), AffectedCamera(model)
    calibration = correct_calibration(twin_calibration(CAMERA), believed)
    perception = perception_of(camera, DENIM, calibration)
    sights = [perception.look(camera.frame(fold, k), fold.pose(k / 60)) for k in FRAMES]
    return np.array([s.contact_x for s in sights]), [s.profile for s in sights]


def _off(profile: Array, curve: Array) -> float:
    """Mean distance [m] of a profile's points from a midline."""
    return float(distances(profile, curve).mean())


@pytest.mark.slow
@pytest.mark.parametrize(("name", "values"), SEEN)
def test_accepted_effect_of_the_camera_is_taken_out_of_what_images_say(
    name: str, values: Values
) -> None:
    plain, affected = describe(DENIM), _model(name, values)
    shapes = [_fold().shape(k / 60) for k in FRAMES]
    contact, profiles = _looks(plain, plain)
    accepted, again = _looks(affected, affected)
    true = np.array([_fold().contact_x(k / 60) for k in FRAMES])
    assert np.abs(accepted - true).max() < np.abs(contact - true).max() + 2e-4
    for before, after, shape in zip(profiles, again, shapes, strict=True):
        assert _off(after, shape) < _off(before, shape) + 2e-4


@pytest.mark.parametrize(("name", "values"), SEEN)
def test_hidden_effect_of_the_camera_is_seen_as_stated(name: str, values: Values) -> None:
    affected = _model(name, values)
    hidden, profiles = _looks(affected, describe(DENIM))
    true = np.array([_fold().contact_x(k / 60) for k in FRAMES])
    np.testing.assert_allclose(hidden, seen_contact(affected.observation, true), atol=9e-4)
    for profile, k in zip(profiles, FRAMES, strict=True):
        assert _off(profile, seen_points(affected, _fold().shape(k / 60))) < 6e-4
