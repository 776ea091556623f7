"""The rendered cell: same seed, same bytes; noise, light, contrast and looks as they
are set.
"""

import numpy as np
import pytest

from drivers.base.types import Pose
from drivers.twin.renderer.looks import StripLook
from drivers.twin.renderer.renderer import Renderer
from drivers.twin.settings import CameraSettings
from tests.support.rendered_cell import empty, scene

SETTINGS = CameraSettings()
DENIM = StripLook((40, 60, 110), 0.001, 0.05)
QUIET = CameraSettings(noise=0.0)


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
    assert not np.array_equal(
        first, Renderer(SETTINGS, DENIM, seed=4).render(exposure, 7)
    )


def test_noise_has_the_stated_sigma_and_no_bias(renderer: Renderer) -> None:
    frames = np.stack(
        [renderer.render([scene("flat")], k)[100:300, 200:900] for k in range(12)]
    )
    frames = frames.astype(float)
    assert frames.std(axis=0, ddof=1).mean() == pytest.approx(SETTINGS.noise, rel=0.1)
    quiet = Renderer(QUIET, DENIM, seed=3)
    clean = quiet.render([scene("flat")], 0)[100:300, 200:900].astype(float)
    assert abs((frames.mean(axis=0) - clean).mean()) < 0.05


def test_what_does_not_move_looks_alike_in_every_frame() -> None:
    quiet = Renderer(QUIET, DENIM, seed=3)
    one, other = (
        quiet.render([scene(kind)], 0).astype(int) for kind in ("flat", "closing")
    )
    nowhere = quiet.render([empty(Pose(0.3, 5.0, np.pi / 2))], 0).astype(int)
    for image in (one, other):
        same = np.abs(image - nowhere).max(axis=-1) == 0
        assert same[:, :30].all()
        assert same[660:].all()
        assert same.mean() > 0.75
    assert np.abs(one - other).max() > 50
