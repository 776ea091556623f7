"""The parts of the segmenter: palette, light, noise, discriminant."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cell.perception.kernels import (
    CELL_PX,
    EVEN_LIGHT,
    LEVEL_SPAN,
    SHADE,
    ZERO_LEVEL,
    discriminants,
    share,
)
from cell.perception.region import Region
from cell.perception.scene import Background, Segmenter, palette, sensor_noise
from drivers.types import Array, Image

RED, BLUE = np.array([30.0, 30.0, 180.0]), np.array([170.0, 60.0, 30.0])
SIZE = (160, 320)
SENSOR = 3.5  # grey levels
ALL = Region(0, 0, SIZE[1], SIZE[0])
SEEN = np.full(SIZE, 255, np.uint8)
colours = st.lists(st.floats(5, 250), min_size=3, max_size=3).map(np.array)


def _weave(colour: Array, count: int, seed: int = 0) -> Array:
    rng = np.random.default_rng(seed)
    return colour * rng.normal(1, 0.04, (count, 1)) + rng.normal(0, 2, (count, 3))


def _scene(seed: int = 1) -> Image:
    rng = np.random.default_rng(seed)
    coarse = rng.uniform(90, 220, (10, 20, 3))
    return coarse.repeat(16, axis=0).repeat(16, axis=1).astype(np.uint8)


def _background(image: Image) -> Background:
    return Background(image, np.full(SIZE, 0.06, np.float32), 5)


def _levels(colours: Array, behind: Image, seen: Image, visible: Image = SEEN) -> Image:
    """Matte levels of the whole picture, wherever anything changed."""
    part, region = Segmenter(colours, _background(behind), SENSOR, SENSOR, 0.02).levels(
        seen, ALL, visible
    )
    levels = np.full(SIZE, ZERO_LEVEL, np.uint8)
    region.of(levels)[:] = part
    return levels


def test_blends_at_the_border_of_stripes_are_no_colour() -> None:
    between = _weave((RED + BLUE) / 2, 100)
    assert len(palette(np.vstack([_weave(RED, 1000), _weave(BLUE, 900), between]))) == 2


@settings(deadline=None)
@given(colours, colours, st.floats(0.02, 0.3))
def test_discriminant_in_closed_form_is_fishers(strip: Array, scene: Array, shade: float) -> None:
    scatter = SENSOR**2 * np.eye(3) + SHADE**2 * np.outer(strip, strip)
    scatter += shade**2 * np.outer(scene, scene)
    weights = np.linalg.solve(scatter, strip - scene)
    floats = (strip.astype(np.float32), scene[None].astype(np.float32))
    found = discriminants(*floats, np.array([shade], np.float32), SENSOR**2)
    a, b, reach, _ = found.T
    assert float(reach[0]) == pytest.approx(float(weights @ (strip - scene)), rel=0.02, abs=0.02)
    assert a[0] * strip + b[0] * scene == pytest.approx(weights, rel=0.03, abs=0.003)


def test_light_is_read_through_a_strip_and_past_a_hand() -> None:
    image = _scene()
    u = np.arange(SIZE[1])
    dimming = 0.75 + 0.25 * np.cos(u / 150)
    seen = (image * dimming[None, :, None]).astype(np.uint8)
    seen[70:78] = 20
    visible = SEEN.copy()
    visible[:50, 120:180] = 0
    seen[:50, 120:180] = 40
    light = _background(image).light(seen, ALL, visible)[1:-1, 1:-1] / EVEN_LIGHT
    true, clear = (
        dimming[CELL_PX // 2 :: CELL_PX],
        visible[CELL_PX // 2 :: CELL_PX, CELL_PX // 2 :: CELL_PX] > 0,
    )
    assert np.abs(light - true)[clear].max() < 0.06
    assert np.abs(light - true).mean() < 0.03


def test_strip_in_a_shadow_over_clutter_is_told_and_the_clutter_is_not() -> None:
    image = _scene()
    seen = (image * np.linspace(1.0, 0.6, SIZE[1])[None, :, None]).astype(np.uint8)
    seen[80:86] = np.linspace(1.0, 0.6, SIZE[1])[:, None] * np.array([20, 20, 20])
    levels = _levels(np.array([[20.0, 20.0, 20.0]]), image, seen)
    assert np.median(share(levels[81:85])) == pytest.approx(1.0, abs=0.1)
    beside = np.vstack([levels[:76], levels[90:]])
    assert (share(beside) > 0.2).mean() < 0.005


def test_every_colour_of_a_pattern_is_strip() -> None:
    image = np.full((*SIZE, 3), 200, np.uint8)
    seen = image.copy()
    seen[80:86, ::2], seen[80:86, 1::2] = RED, BLUE
    levels = _levels(np.array([RED, BLUE]), image, seen)
    assert levels[82:84].min() > ZERO_LEVEL + 0.9 * LEVEL_SPAN


def test_what_the_hand_hides_is_background() -> None:
    image = np.full((*SIZE, 3), 200, np.uint8)
    seen, visible = image.copy(), SEEN.copy()
    seen[40:120, 100:200], visible[30:130, 90:210] = RED, 0
    assert (_levels(RED[None], image, seen, visible) == ZERO_LEVEL).all()


@pytest.mark.parametrize("noise", [1.0, 2.5, 8.0])
def test_noise_of_a_picture_is_learnt_past_its_scene(noise: float) -> None:
    rng = np.random.default_rng(3)
    scene = _scene()[:40, :80].repeat(4, axis=0).repeat(4, axis=1)
    seen = scene + rng.normal(0, noise, (*SIZE, 3))
    assert sensor_noise(np.rint(seen).astype(np.uint8)) == pytest.approx(noise, rel=0.15)


def test_nothing_is_strip_where_nothing_changed() -> None:
    image = _scene()
    assert (_levels(RED[None], image, image) == ZERO_LEVEL).all()
