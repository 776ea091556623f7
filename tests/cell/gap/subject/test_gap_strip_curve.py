"""Signed distances to moving curves, robust means, and curves cleared of wild points."""

import numpy as np
import pytest

from cell.gap.subject.strip.curves import believable, images_of
from cell.record.columns import Profile
from drivers.strip.curve import signed_distances
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


def test_a_layer_that_is_nearer_but_elsewhere_on_the_strip_is_not_taken() -> None:
    lower = np.stack([np.linspace(0.0, 0.3, 31), np.zeros(31)], axis=1)
    upper = np.stack([np.linspace(0.3, 0.0, 31), np.full(31, 0.01)], axis=1)
    curve = np.concatenate([lower, upper[1:]])
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(curve, axis=0).T))])
    point = np.array([[0.1, 0.002]])
    found = distances(point, np.array([arc[-1] - 0.1]), curve[None], arc)
    assert found[0] == pytest.approx(0.008, abs=1e-6)


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
