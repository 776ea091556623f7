"""The map to the plane of the near edge, and where the camera stands."""

import cv2
import numpy as np
import pytest

from calibration.homography import (
    Homography,
    fit_homography,
    homography_of,
    map_deviation,
    viewpoint,
)
from calibration.lens import Lens
from drivers.base.errors import ConfigurationError
from drivers.base.types import Array

LENS = Lens.pinhole((1280, 720), 3400.0, (645.0, 355.0))
CENTRE = np.array([0.31, -2.0, 0.105])
POINTS = np.array(
    [(x, z) for x in np.linspace(0, 0.6, 5) for z in np.linspace(0.02, 0.32, 4)]
)


def _seen(points: Array) -> Array:
    """Pixels of points in the plane y = 0, from a camera that looks along +y, a bit
    turned.
    """
    turn = cv2.Rodrigues(np.array([0.02, -0.015, 0.01]))[0]
    look = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    return _pixels(points, CENTRE, turn @ look)


def _pixels(points: Array, centre: Array, look: Array) -> Array:
    """Pixels of points in the plane y = 0, from a camera at `centre` that is turned to
    `look`.
    """
    rays = (np.insert(points, 1, 0.0, axis=1) - centre) @ look.T
    return rays[:, :2] / rays[:, 2:] * 3400.0 + LENS.matrix[:2, 2]


def test_exact_points_give_the_exact_map_and_its_inverse() -> None:
    homography, used = fit_homography(_seen(POINTS), POINTS)
    away = np.array([[0.1, 0.2], [0.55, 0.01]])
    assert np.abs(homography.to_plane(_seen(away)) - away).max() < 1e-7
    assert np.abs(homography.to_image(away) - _seen(away)).max() < 1e-3
    assert used.all()


def test_outliers_do_not_move_the_map() -> None:
    pixels = _seen(POINTS)
    pixels[[3, 11]] += (9.0, -14.0)
    homography, used = fit_homography(pixels, POINTS)
    assert np.flatnonzero(~used).tolist() == [3, 11]
    assert np.abs(homography.to_plane(_seen(POINTS)) - POINTS).max() < 1e-6


NOISE = np.random.default_rng(1).uniform(-60, 60, (len(POINTS), 2))  # px
LINE = np.column_stack([np.linspace(0, 0.6, 20), np.full(20, 0.1)])


@pytest.mark.parametrize(
    ("pixels", "points", "message"),
    [
        (_seen(POINTS)[:11], POINTS[:11], "11 touched points, at least 12"),
        (_seen(POINTS) + NOISE, POINTS, "touched points"),
        (_seen(LINE), LINE, "the touched points determine no map"),
    ],
)
def test_points_that_are_few_or_disagree_are_refused(pixels, points, message) -> None:
    with pytest.raises(ConfigurationError, match=message):
        fit_homography(pixels, points)


def test_singular_matrix_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="singular"):
        Homography.from_matrix(np.ones((3, 3)))


def test_camera_centre_follows_from_lens_and_map() -> None:
    rng = np.random.default_rng(2)
    homography, _ = fit_homography(
        _seen(POINTS) + 0.05 * rng.normal(size=(len(POINTS), 2)), POINTS
    )
    where = viewpoint(LENS, homography)
    assert np.abs(where.foot() - CENTRE[[0, 2]]).max() < 0.01
    assert abs(where.distance - 2.0) < 0.01


def test_far_edge_appears_drawn_towards_the_foot() -> None:
    homography, _ = fit_homography(_seen(POINTS), POINTS)
    where = viewpoint(LENS, homography)
    depth = 0.05
    ray = np.array([0.5, depth, 0.02]) - CENTRE
    plane = CENTRE + ray * (2.0 / ray[1])
    drawn = np.array([0.5, 0.02]) + where.sweep(depth) * (where.foot() - (0.5, 0.02))
    assert np.abs(drawn - plane[[0, 2]]).max() < 1e-4


def test_camera_that_looks_from_behind_the_strip_is_refused() -> None:
    look = np.array([[-1.0, 0, 0], [0, 0, -1], [0, -1, 0]])  # along -y, from y = +2
    pixels = _pixels(POINTS, CENTRE * (1, -1, 1), look)
    homography, _ = fit_homography(pixels, POINTS)
    with pytest.raises(ConfigurationError, match="from behind"):
        viewpoint(LENS, homography)


def test_map_is_known_as_well_as_maps_from_noisy_points_scatter() -> None:
    away = np.array([[0.1, 0.2], [0.55, 0.01], [0.7, 0.5]])
    rng = np.random.default_rng(0)
    errors, stated = [], []
    for _ in range(300):
        pixels = _seen(POINTS) + rng.normal(0, 0.3, POINTS.shape)
        fitted = homography_of(pixels, POINTS)
        errors.append(fitted.to_plane(_seen(away)) - away)
        stated.append(map_deviation(fitted, pixels, POINTS, away) ** 2)
    scatter = np.einsum("nki,nkj->kij", errors, errors) / len(errors)
    largest = np.linalg.eigvalsh(scatter)[:, -1]
    assert np.mean(stated, axis=0) == pytest.approx(largest, rel=0.25)
