"""The twin's camera: same seed, same bytes; noise, light, contrast as the settings say."""

from pathlib import Path

import numpy as np
import pytest

from drivers.errors import ConfigurationError
from drivers.strip.describe import load_strip
from drivers.strip.file import StripFile
from drivers.twin.renderer.looks import StripLook
from drivers.twin.renderer.optics import Optics
from drivers.twin.renderer.renderer import Renderer
from drivers.twin.settings import CameraSettings
from tests.support.rendered_cell import empty, midline, scene

SETTINGS = CameraSettings()
DENIM = StripLook((40, 60, 110), 0.001, 0.05)
STRIPS = sorted((Path(__file__).parents[3] / "configs" / "strips").glob("*.yaml"))


@pytest.fixture(scope="module")
def renderer() -> Renderer:
    return Renderer(SETTINGS, DENIM, seed=3)


def test_frame_depends_on_seed_scenes_and_sequence_alone(renderer: Renderer) -> None:
    exposure = [scene("high", shift=(dx, 0.0)) for dx in (0.0, 0.001, 0.002)]
    first = renderer.render(exposure, 7)
    renderer.render([scene("laid")], 8)
    assert np.array_equal(first, renderer.render(exposure, 7))
    assert np.array_equal(first, Renderer(SETTINGS, DENIM, seed=3).render(exposure, 7))
    assert not np.array_equal(first, renderer.render(exposure, 9))
    assert not np.array_equal(first, Renderer(SETTINGS, DENIM, seed=4).render(exposure, 7))


def test_image_is_of_the_stated_size(renderer: Renderer) -> None:
    image = renderer.render([scene("flat")], 0)
    assert image.shape == (720, 1280, 3)
    assert image.dtype == np.uint8


def test_frame_of_nothing_is_refused(renderer: Renderer) -> None:
    with pytest.raises(ConfigurationError, match="scenes"):
        renderer.render([], 0)


def test_noise_has_the_stated_sigma_and_no_bias(renderer: Renderer) -> None:
    frames = np.stack([renderer.render([scene("flat")], k)[100:300, 200:900] for k in range(12)])
    frames = frames.astype(float)
    assert frames.std(axis=0, ddof=1).mean() == pytest.approx(SETTINGS.noise, rel=0.1)
    quiet = Renderer(SETTINGS.model_copy(update={"noise": 0.0}), DENIM, seed=3)
    clean = quiet.render([scene("flat")], 0)[100:300, 200:900].astype(float)
    assert abs((frames.mean(axis=0) - clean).mean()) < 0.05


def test_what_does_not_move_looks_alike_in_every_frame() -> None:
    quiet = Renderer(SETTINGS.model_copy(update={"noise": 0.0}), DENIM, seed=3)
    one, other = (quiet.render([scene(kind)], 0).astype(int) for kind in ("flat", "closing"))
    nowhere = quiet.render([empty(0.3, 5.0)], 0).astype(int)
    for image in (one, other):
        same = np.abs(image - nowhere).max(axis=-1) == 0
        assert same[:, :70].all()
        assert same[660:].all()
        assert same.mean() > 0.75
    assert np.abs(one - other).max() > 50


@pytest.mark.parametrize("outside", [(2.0, 0.2), (-2.0, 0.2), (0.3, 5.0), (0.3, -3.0)])
def test_hand_outside_the_image_changes_nothing(
    renderer: Renderer, outside: tuple[float, float]
) -> None:
    here = renderer.render([empty(*outside, pointer=True)], 0)
    there = renderer.render([empty(0.3, 5.0)], 0)
    assert np.array_equal(here, there)


def looks() -> list[StripFile]:
    plain = load_strip(STRIPS[0])
    extremes = {"white": (240, 238, 232), "black": (22, 22, 24), "grey": (128, 128, 128)}
    return [load_strip(path) for path in STRIPS] + [
        plain.model_copy(update={"name": name, "colour": colour, "thickness": 0.001})
        for name, colour in extremes.items()
    ]


@pytest.mark.parametrize("strip", looks(), ids=lambda strip: strip.name)
def test_every_strip_stands_out_from_desk_and_backdrop(strip: StripFile) -> None:
    renderer = Renderer(SETTINGS, StripLook.of(strip), seed=0)
    image = renderer.render([scene("lifted")], 0).astype(float)
    points, _ = midline("lifted")
    optics = Optics.of(SETTINGS)
    lying = optics.plane(points[60:300], 0.02)
    hanging = optics.plane(points[380:560], 0.004)
    for place, aside in ((lying, (0.0, -14.0)), (hanging, (-25.0, 0.0))):
        there, beside = (
            image[tuple((place + shift).round().astype(int).T[::-1])].mean(axis=0)
            for shift in ((0.0, 0.0), aside)
        )
        assert np.linalg.norm(there - beside) > 40


def test_identity_tells_any_two_settings_apart() -> None:
    others = [{"exposure": 0.003}, {"roll": 0.0041}, {"distortion": (-0.18, 0.11)}, {"noise": 2.5}]
    identities = {SETTINGS.model_copy(update=change).identity for change in others}
    assert len(identities | {SETTINGS.identity}) == 5
    assert CameraSettings().identity == SETTINGS.identity


def test_exposure_longer_than_its_frame_or_its_delay_is_refused() -> None:
    with pytest.raises(ValueError, match="longer than a frame"):
        CameraSettings(exposure=0.018)
    with pytest.raises(ValueError, match="before the exposure"):
        CameraSettings(transport_delay=0.001)
