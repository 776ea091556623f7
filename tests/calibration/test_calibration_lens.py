"""The lens: undistortion and fits."""

import numpy as np

from calibration.lens import Lens, fit_lens
from drivers.types import Array, frozen

MATRIX = frozen([[3400.0, 0, 645.0], [0, 3400.0, 355.0], [0, 0, 1]])
LENS = Lens(1280, 720, MATRIX, frozen([-0.18, 0.1, 0.001, -0.002, 0.0]))


def _views(lens: Lens, tilts: list[tuple[float, float]], noise: float) -> tuple[list[Array], ...]:
    rng = np.random.default_rng(3)
    board = np.array([(i * 0.03, j * 0.03, 0.0) for i in range(9) for j in range(7)])
    board -= board.mean(axis=0)
    images = []
    for a, b in tilts:
        ca, sa, cb, sb = np.cos(a), np.sin(a), np.cos(b), np.sin(b)
        rotation = np.array([[1, 0, 0], [0, ca, -sa], [0, sa, ca]]) @ np.array(
            [[cb, 0, sb], [0, 1, 0], [-sb, 0, cb]]
        )
        shift = np.array([*rng.uniform(-0.12, 0.12, 2) * (1, 0.4), rng.uniform(1.6, 2.1)])
        seen = board @ rotation.T + shift
        ideal = seen[:, :2] / seen[:, 2:] * lens.matrix[0, 0] + lens.matrix[:2, 2]
        images.append(lens.distort(ideal) + noise * rng.normal(size=(len(board), 2)))
    return [board] * len(tilts), images


def test_undistort_and_distort_are_inverse_over_the_whole_image() -> None:
    rng = np.random.default_rng(0)
    pixels = rng.uniform((0, 0), (1280, 720), (200, 2))
    assert np.abs(LENS.distort(LENS.undistort(pixels)) - pixels).max() < 1e-6
    assert np.abs(LENS.undistort(pixels) - pixels).max() > 1.0


def test_lens_is_found_from_tilted_views() -> None:
    tilts = [(a, b) for a in (-0.5, 0.0, 0.5) for b in (-0.5, 0.0, 0.5)]
    fit = fit_lens(*_views(LENS, tilts, 0.05), (1280, 720))
    assert fit.rms < 0.1
    assert abs(fit.lens.matrix[0, 0] / 3400 - 1) < 0.005
    corners = np.array([[40.0, 40.0], [1240.0, 680.0], [640.0, 40.0]])
    spread = fit.lens.undistort(corners) - LENS.undistort(corners)
    assert np.abs(spread - spread.mean(axis=0)).max() < 1.5
