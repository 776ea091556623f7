"""Shadows in a matte: taken out from behind a strip, which stays."""

import cv2
import numpy as np
import pytest

from calibration.perception.matte import SCALE, ZERO, share
from calibration.perception.shade import without_shade
from drivers.types import Image

LIFTED = np.full((400, 600), 255, np.uint8)


def scene(shade: float) -> Image:
    """A matte of a strip 3 px wide before a wall, on whose right half a soft shadow falls."""
    wall = np.zeros(LIFTED.shape, np.float32)
    wall[:, 300:] = shade
    wall = cv2.GaussianBlur(wall, (0, 0), 12)
    strip = np.zeros_like(wall)
    strip[:, 320:323] = 1.0
    noise = 0.01 * np.random.default_rng(0).normal(size=wall.shape)
    seen = wall + strip * (1 - wall) + noise
    return np.rint(ZERO + SCALE * seen).astype(np.uint8)


@pytest.mark.parametrize("shade", [0.1, 0.2, 0.3])
def test_shadow_behind_a_strip_is_taken_out_and_the_strip_stays(shade: float) -> None:
    levels = scene(shade)
    before, after = share(levels), share(without_shade(levels, LIFTED))
    assert before[:, 400:].mean() > 0.8 * shade
    assert abs(after[:, 400:].mean()) < 0.02
    assert after[:, 321].mean() > 0.95


def test_matte_without_a_shadow_is_returned_as_it_is() -> None:
    levels = scene(0.0)
    assert without_shade(levels, LIFTED) is levels


def test_desk_is_left_alone() -> None:
    levels, high = scene(0.2), LIFTED.copy()
    high[200:] = 0
    assert np.array_equal(without_shade(levels, high)[200:], levels[200:])
