"""Signed distances to moving curves, robust means, and curves cleared of wild points."""

import numpy as np
import pytest

from cell.gap.subject.strip.curves import believable, images_of, smooth_path
from cell.record.columns import Profile
from drivers.strip.curve import group_means, nearest_ends, signed_distances
from drivers.types import Array

RADIUS = 0.05  # m


def arc_of(radius: float, nodes: int = 41) -> tuple[Array, Array]:
    """Half a circle that turns left, (nodes, 2), and its arc lengths."""
    angle = np.linspace(0.0, np.pi, nodes)
    curve = np.stack([radius * np.sin(angle), radius * (1 - np.cos(angle))], axis=1)
    return curve, radius * angle


def distances(points: Array, near: Array, shapes: Array, arc: Array, place: float = 0.0) -> Array:
    found = np.empty(len(points))
    image = np.zeros(len(points), dtype=np.int64)
    single = shapes.astype(np.float32)
    signed_distances(points, image, near, np.array([place]), single, arc, found)
    return found


def test_distance_is_signed_and_sees_the_arc_between_nodes() -> None:
    curve, arc = arc_of(RADIUS)
    rng = np.random.default_rng(1)
    angle, off = rng.uniform(0.05, 3.09, 300), rng.normal(0.0, 0.002, 300)
    out = RADIUS - off  # the centre lies to the left
    points = np.stack([out * np.sin(angle), RADIUS - out * np.cos(angle)], axis=1)
    found = distances(points, RADIUS * angle, curve[None], arc)
    np.testing.assert_allclose(found, off, atol=2e-5)


def test_the_curve_is_taken_between_its_shapes() -> None:
    flat = np.stack([np.linspace(0.0, 0.6, 61), np.zeros(61)], axis=1)
    shapes = np.stack([flat, flat + np.array([0.0, 0.01])])
    points = np.array([[0.305, 0.004]])
    for place, height in ((0.0, 0.004), (0.3, 0.001), (1.0, -0.006), (7.0, -0.006)):
        found = distances(points, np.array([0.3]), shapes, flat[:, 0], place)
        assert found[0] == pytest.approx(height, abs=1e-7)


def test_a_layer_that_is_nearer_but_elsewhere_on_the_strip_is_not_taken() -> None:
    lower = np.stack([np.linspace(0.0, 0.3, 31), np.zeros(31)], axis=1)
    upper = np.stack([np.linspace(0.3, 0.0, 31), np.full(31, 0.01)], axis=1)
    curve = np.concatenate([lower, upper[1:]])
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(curve, axis=0).T))])
    point = np.array([[0.1, 0.002]])
    found = distances(point, np.array([arc[-1] - 0.1]), curve[None], arc)
    assert found[0] == pytest.approx(0.008, abs=1e-6)


def test_lying_strip_ends_at_each_hump_and_at_the_fold() -> None:
    """Up to the fold's rightmost point: its upper layer, back near the desk, is none of it."""
    x = np.concatenate([np.linspace(0.0, 0.4, 41), np.linspace(0.39, 0.1, 30)])
    z = np.concatenate([np.zeros(41), np.full(30, 0.02)])
    z[20:23], z[38:41], z[60:] = 0.002, (0.002, 0.005, 0.01), 0.0005
    shapes = np.stack([x, z], axis=1)[None].astype(np.float32)
    seen = np.array([0.0, 0.2, 0.28, 0.29, 0.37, 0.5])
    found = np.full(len(seen), 0.375)
    nearest_ends(seen, np.zeros(len(seen)), shapes, 0.001, found)
    np.testing.assert_allclose(found, [0.195, 0.195, 0.195, 0.375, 0.375, 0.375], atol=1e-6)


def test_means_forgive_wild_values() -> None:
    rng = np.random.default_rng(2)
    good = rng.normal(0.001, 0.0005, 40)
    values = np.concatenate([good, [0.5], good[:10], [-0.3]])
    mean, square = np.empty(2), np.empty(2)
    group_means(values, np.array([0, 41, 52]), 0.0005, mean, square)
    np.testing.assert_allclose(mean, 0.001, atol=4e-4)
    assert (square < 4e-6).all()


@pytest.mark.parametrize("wild", [0, 1, 20, 48, 49])
def test_wild_points_are_told_wherever_they_are(wild: int) -> None:
    curve, _ = arc_of(0.2, 50)
    curve = curve + np.random.default_rng(3).normal(0.0, 0.0005, curve.shape)
    curve[wild] += 0.04
    kept = believable(curve, 0.0005)
    assert not kept[wild]
    assert kept.sum() >= 46


def test_images_tell_how_far_along_the_strip_their_points_lie() -> None:
    curve, arc = arc_of(0.1, 60)
    t = np.repeat(np.arange(30) / 60.0, 60)
    points = np.tile(curve, (30, 1))
    profile = Profile(t, np.tile(np.arange(60.0), 30), points[:, 0], points[:, 1])
    grip = np.tile(curve[-1], (len(t), 1))
    images = images_of(profile, grip, 0.6, 0.001)
    assert len(images.stamps) == 10
    assert np.diff(images.stamps).min() > 0.04
    first = images.s[images.image == 0]
    assert first[0] == pytest.approx(0.6 - arc[-1], abs=1e-3)
    assert first[-1] == pytest.approx(0.6, abs=1e-3)


def test_smoothing_takes_noise_out_and_leaves_corners() -> None:
    t = np.arange(0.0, 2.0, 0.01)
    corner = 0.1 * np.maximum(t - 1.0, 0.0)
    true = np.column_stack([0.6 - 0.1 * t, corner, np.zeros_like(t)])
    noisy = true + np.random.default_rng(4).normal(0.0, 3e-4, true.shape)
    fine, poses = smooth_path(t, noisy, 3e-4)
    exact = np.interp(fine, t, corner)
    assert np.std(poses[:, 1] - exact) < 2e-4
    _, quiet = smooth_path(t, true, 2e-5)
    assert np.abs(quiet[:, 1] - exact).max() < 5e-4
