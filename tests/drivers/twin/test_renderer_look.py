"""The rendered cell: same seed, same bytes; noise, light, contrast and looks as they are set."""

from pathlib import Path

import numpy as np
import pytest

from drivers.strip.describe import load_strip
from drivers.strip.file import StripFile
from drivers.twin.renderer.looks import (
    PLAIN,
    Box,
    Look,
    StripLook,
)
from drivers.twin.renderer.optics import Optics
from drivers.twin.renderer.renderer import Renderer
from drivers.twin.scene import Scene
from drivers.twin.settings import CameraSettings
from drivers.types import Array
from tests.support.rendered_cell import empty, midline, scene

SETTINGS = CameraSettings()
DENIM = StripLook((40, 60, 110), 0.001, 0.05)
STRIPS = sorted((Path(__file__).parents[3] / "configs" / "strips").glob("*.yaml"))
QUIET = CameraSettings(noise=0.0)
SMALL = CameraSettings(width=640, height=360, noise=0.0)


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


def test_noise_has_the_stated_sigma_and_no_bias(renderer: Renderer) -> None:
    frames = np.stack([renderer.render([scene("flat")], k)[100:300, 200:900] for k in range(12)])
    frames = frames.astype(float)
    assert frames.std(axis=0, ddof=1).mean() == pytest.approx(SETTINGS.noise, rel=0.1)
    quiet = Renderer(QUIET, DENIM, seed=3)
    clean = quiet.render([scene("flat")], 0)[100:300, 200:900].astype(float)
    assert abs((frames.mean(axis=0) - clean).mean()) < 0.05


def test_what_does_not_move_looks_alike_in_every_frame() -> None:
    quiet = Renderer(QUIET, DENIM, seed=3)
    one, other = (quiet.render([scene(kind)], 0).astype(int) for kind in ("flat", "closing"))
    nowhere = quiet.render([empty(0.3, 5.0)], 0).astype(int)
    for image in (one, other):
        same = np.abs(image - nowhere).max(axis=-1) == 0
        assert same[:, :70].all()
        assert same[660:].all()
        assert same.mean() > 0.75
    assert np.abs(one - other).max() > 50


def looks() -> list[StripFile]:
    plain = load_strip(STRIPS[0])
    extremes = {"white": (240, 238, 232), "black": (22, 22, 24), "grey": (128, 128, 128)}
    return [load_strip(path) for path in STRIPS] + [
        plain.model_copy(update={"name": name, "colour": colour, "thickness": 0.001})
        for name, colour in extremes.items()
    ]


@pytest.mark.slow
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


def _drawn(look: Look, at: Scene, settings: CameraSettings = SMALL) -> Array:
    strip = StripLook(DENIM.colour, DENIM.thickness, DENIM.width, look.pattern)
    return Renderer(settings, strip, 0, surround=look).render([at], 0).astype(float)


def test_things_stand_still_behind_the_strip_and_never_before_it() -> None:
    wall = Look(things=(Box((0.0, 0.1, 0.0), (0.6, 0.2, 0.3), (250, 250, 250)),))
    bare, covered = (_drawn(look, scene("lifted"), QUIET) for look in (PLAIN, wall))
    points, _ = midline("lifted")
    optics = Optics.of(QUIET)
    u, v = optics.plane(points[60:300:20], 0.02).round().astype(int).T
    assert np.abs(bare[v, u] - covered[v, u]).max() < 60
    there, elsewhere = (
        optics.plane(np.array([at])).round().astype(int)[0] for at in ((0.2, 0.2), (0.65, 0.2))
    )
    assert np.abs(bare - covered)[there[1], there[0]].max() > 100
    assert np.abs(bare - covered)[elsewhere[1], elsewhere[0]].max() < 10


@pytest.mark.parametrize("thickness", [0.004, 0.008])
def test_thick_strip_is_as_wide_as_its_thickness_and_what_is_seen_of_its_face(
    thickness: float,
) -> None:
    strip = StripLook((200, 30, 30), thickness, 0.05)
    at, bare = scene("lifted"), empty(0.3, 5.0)
    seen, without = (Renderer(QUIET, strip, 0).render([it], 0).astype(float) for it in (at, bare))
    points, _ = midline("lifted")
    optics, k = Optics.of(QUIET), 540  # hangs, its face in sight
    near, far = (optics.plane(points[k], y) for y in (0.0, 0.05))
    scale = QUIET.distance / QUIET.focal
    row = np.abs(seen - without)[int(near[1])].max(axis=-1)
    columns = slice(int(near[0]) - 60, int(near[0]) + 60)
    found = (row[columns] > 60).sum() * scale
    swept = abs(far[0] - near[0]) * scale
    assert found == pytest.approx(thickness + swept - 0.001, abs=0.0012)
