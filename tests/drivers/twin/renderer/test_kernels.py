"""The compiled loops of the renderer give the bytes of their formulas, and compile in time."""

import numpy as np
import pytest

from drivers.twin.renderer import kernels
from drivers.twin.renderer.kernels import FULL, splat
from drivers.twin.renderer.looks import StripLook
from drivers.twin.renderer.renderer import Renderer
from drivers.twin.settings import CameraSettings
from tests.support.rendered_cell import scene

COLOUR = np.array([40.0, 90.0, 200.0])
ORIGIN = (3, 2)


def by_formula(image, points, tint, light):
    """`splat` in sums over whole arrays, whose order numpy keeps."""
    u, v, area, shade = points[:4]
    u, v, width = u - ORIGIN[0], v - ORIGIN[1], image.shape[1]
    inside = (u >= 0) & (u < width - 1) & (v >= 0) & (v < image.shape[0] - 1)
    u, v, area, shade = u[inside], v[inside], area[inside], shade[inside]
    j, i = u.astype(int), v.astype(int)
    a, b, first = u - j, v - i, i * width + j
    right = area * a
    left = area - right
    index = np.concatenate([first, first + 1, first + width, first + width + 1])
    weight = np.concatenate([left - left * b, right - right * b, left * b, right * b])
    size, glows = image.shape[0] * width, weight * np.tile(shade, 4)
    coverage, glow = np.bincount(index, weight, size), np.bincount(index, glows, size)
    alpha = np.minimum(coverage / FULL, 1.0)
    seen = light[ORIGIN[1] :, ORIGIN[0] :][: image.shape[0], :width]
    ink = glow / np.maximum(coverage, 1e-12) * seen.ravel() * alpha
    mixed = COLOUR
    if len(tint):
        parts = [np.bincount(index, glows * np.tile(c[inside], 4), size) for c in tint.T]
        mixed = np.stack(parts, -1) / np.maximum(glow, 1e-12)[:, None]
    level = image.reshape(-1, 3) * (1 - alpha)[:, None] + ink[:, None] * mixed + 0.5
    return np.minimum(level, 255).astype(np.uint8).reshape(image.shape)


@pytest.mark.parametrize("tinted", [False, True])
def test_points_leave_the_same_bytes_as_by_formula(tinted) -> None:
    rng = np.random.default_rng(3)
    points = rng.uniform(0, 1, (6, 4000)) * np.array([[40], [30], [0.5], [1.5], [1], [1]])
    tint = rng.uniform(0, 255, (4000, 3)) if tinted else np.empty((0, 0))
    light = rng.uniform(0.7, 1.3, (40, 60)).astype(np.float32)
    image = rng.integers(0, 256, (25, 33, 3), dtype=np.uint8)
    made = image.copy()
    splat(made, points, tint, COLOUR, light, ORIGIN)
    assert (made != image).mean() > 0.5
    np.testing.assert_array_equal(made, by_formula(image, points, tint, light))


def test_a_renderer_has_compiled_all_that_its_frames_need() -> None:
    renderer = Renderer(CameraSettings(), StripLook((200, 40, 40), 0.001, 0.1), 1)
    entries = [kernels.plane, kernels.interpolate, kernels.sow, kernels.splat]
    before = [len(entry.signatures) for entry in entries]
    renderer.render([scene("lifted"), scene("lifted", 0.001, (0.0, 0.001))], 0)
    assert min(before) > 0
    assert [len(entry.signatures) for entry in entries] == before
