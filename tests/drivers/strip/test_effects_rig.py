"""What the rig reports and what is true: the grip's path, the camera's picture, and back."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.strip.grip_path import growth, reported_poses, true_path, true_poses
from drivers.strip.model import Observation, Rig
from drivers.strip.observation import (
    seen_contact,
    seen_points,
    seen_time,
    seen_touch,
    shown_time,
    true_points,
)
from drivers.strip.shape import Touch
from tests.support.effect_cases import PATHS, affected, bare, way

SMALL = st.floats(-0.05, 0.05)
PATH = way(PATHS["triangular"])


def test_rig_without_effects_moves_the_very_path_that_it_reports() -> None:
    t, poses = true_path(Rig(), PATH.t, PATH.poses)
    assert t is PATH.t
    assert poses is PATH.poses


def test_offsets_grow_from_nothing_over_the_first_ten_centimetres() -> None:
    rig = Rig(grip_x=0.003, grip_z=-0.002, grip_tilt=0.1)
    t, poses = true_path(rig, PATH.t, PATH.poses)
    offset = poses - PATH.poses
    travel = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(PATH.poses[:, :2], axis=0).T))])
    np.testing.assert_array_equal(t, PATH.t)
    np.testing.assert_array_equal(offset[0], 0.0)
    share = np.minimum(travel / 0.10, 1.0)
    np.testing.assert_allclose(offset, share[:, None] * [0.003, -0.002, 0.1], atol=1e-12)


def test_strip_that_hangs_has_its_lift_behind_it() -> None:
    _, poses = true_path(Rig(grip_x=0.003), PATH.t, PATH.poses, hanging=True)
    np.testing.assert_allclose(poses[:, 0] - PATH.poses[:, 0], 0.003)


def test_offsets_grown_do_not_shrink_on_the_way_back() -> None:
    there = np.linspace([0.6, 0.0, 0.0], [0.45, 0.15, 1.5], 20)
    share = growth(np.concatenate([there, there[::-1]]))
    assert (np.diff(share) >= 0).all()
    assert share[-1] == 1.0


def test_noise_of_a_gripper_at_rest_does_not_grow_offsets() -> None:
    rest = np.random.default_rng(0).normal(0.0, 0.0003, size=(500, 3))
    assert growth(rest).max() < 0.02


def test_gripper_was_at_the_reported_place_before() -> None:
    t, poses = true_path(Rig(delay=0.03), PATH.t, PATH.poses)
    np.testing.assert_allclose(PATH.t - t, 0.03)
    np.testing.assert_array_equal(poses, PATH.poses)


def test_higher_desk_brings_the_grip_nearer_to_it_and_the_picture_up() -> None:
    model = affected("desk_height", height=0.004)
    _, poses = true_path(model.rig, PATH.t, PATH.poses)
    assert poses[-1, 1] == pytest.approx(PATH.poses[-1, 1] - 0.004)
    seen = seen_points(model, np.array([[0.2, 0.0]]))
    np.testing.assert_allclose(seen, [[0.2, 0.004]])


@given(x=SMALL, z=SMALL, tilt=SMALL, height=SMALL, share=st.floats(0.0, 1.0))
def test_commands_to_the_arm_compensate_its_errors(
    x: float, z: float, tilt: float, height: float, share: float
) -> None:
    rig = Rig(grip_x=x, grip_z=z, grip_tilt=tilt, desk_height=height)
    wanted = np.array([[0.4, 0.2, 1.5], [0.1, 0.0, 0.3]])
    there = true_poses(rig, reported_poses(rig, wanted, share), share)
    np.testing.assert_allclose(there, wanted, atol=1e-12)


@given(scale=SMALL, x=SMALL, z=SMALL, bias=SMALL, latency=SMALL, height=SMALL)
def test_perception_compensates_the_camera_errors(
    scale: float, x: float, z: float, bias: float, latency: float, height: float
) -> None:
    observation = Observation(0.001, latency, scale, x, z, bias)
    model = replace(bare(), observation=observation, rig=Rig(desk_height=height))
    points = np.array([[0.1, 0.0], [0.55, 0.2]])
    np.testing.assert_allclose(true_points(model, seen_points(model, points)), points, atol=1e-12)
    assert shown_time(observation, seen_time(observation, 2.0)) == pytest.approx(2.0, abs=1e-12)


def test_camera_without_effects_sees_the_truth() -> None:
    model, points = bare(), np.array([[0.3, 0.1], [0.0, 0.0]])
    touch = Touch(4.2, 0.26, 0.33, 0.26)
    grip = np.array([0.01, 0.02, np.pi / 2])
    np.testing.assert_array_equal(seen_points(model, points), points)
    np.testing.assert_array_equal(seen_contact(model.observation, points[:, 0]), points[:, 0])
    assert seen_time(model.observation, 1.5) == 1.5
    assert seen_touch(model, touch, grip, grip) == touch


@pytest.mark.parametrize(
    ("name", "values", "time", "x", "to_grasped"),
    [
        ("camera_latency", {"time": 0.02}, 0.02, 0.0, 0.0),
        ("homography_scale", {"scale": 0.01}, 0.0, 0.0026, 0.0033 - 0.0002),
        ("homography_shift", {"x": 0.004, "z": 0.003}, 0.0, 0.004, -0.003),
        ("contact_bias", {"bias": 0.01}, 0.0, 0.0, 0.0),
    ],
)
def test_touch_is_seen_through_the_effects_of_the_camera(
    name: str, values: dict[str, float], time: float, x: float, to_grasped: float
) -> None:
    touch, grip = Touch(4.2, 0.26, 0.33, 0.26), np.array([0.01, 0.02, np.pi / 2])
    seen = seen_touch(affected(name, **values), touch, grip, grip)
    assert seen.time - touch.time == pytest.approx(time)
    assert seen.x - touch.x == pytest.approx(x)
    assert seen.to_fixed == seen.x
    assert seen.to_grasped - touch.to_grasped == pytest.approx(to_grasped)


def test_touch_is_measured_up_to_where_the_arm_says_that_the_grip_is() -> None:
    touch, grip = Touch(4.2, 0.26, 0.33, 0.26), np.array([0.01, 0.02, np.pi / 2])
    reported = grip - (0.0, 0.003, 0.0)
    seen = seen_touch(bare(), touch, grip, reported)
    assert seen.to_grasped == pytest.approx(0.33 - 0.003)
