"""What the rig reports and what is true: the grip's path, the camera's picture, and
back.
"""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st

from drivers.strip.engine import Touch
from drivers.strip.model import ObservationModel, Rig
from drivers.strip.observation import (
    image_stamp,
    imaged_time,
    measured_contact,
    measured_points,
    measured_touch,
    reported_poses,
    true_path,
    true_points,
    true_poses,
)
from tests.support.effect_cases import PATHS, affected, bare, way

SMALL = st.floats(-0.05, 0.05)
PATH = way(PATHS["triangular"])


def test_rig_without_effects_moves_the_very_path_that_it_reports() -> None:
    t, poses = true_path(Rig(), PATH.t, PATH.poses)
    assert t is PATH.t
    assert poses is PATH.poses


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
    observation = ObservationModel(0.001, latency, scale, x, z, bias)
    model = replace(bare(), observation=observation, rig=Rig(desk_height=height))
    points = np.array([[0.1, 0.0], [0.55, 0.2]])
    np.testing.assert_allclose(
        true_points(model, measured_points(model, points)), points, atol=1e-12
    )
    assert imaged_time(observation, image_stamp(observation, 2.0)) == pytest.approx(
        2.0, abs=1e-12
    )


def test_camera_without_effects_sees_the_truth() -> None:
    model, points = bare(), np.array([[0.3, 0.1], [0.0, 0.0]])
    touch = Touch(4.2, 0.26, 0.33, 0.26)
    grip = np.array([0.01, 0.02, np.pi / 2])
    np.testing.assert_array_equal(measured_points(model, points), points)
    np.testing.assert_array_equal(
        measured_contact(model.observation, points[:, 0]), points[:, 0]
    )
    assert image_stamp(model.observation, 1.5) == 1.5
    assert measured_touch(model, touch, grip, grip) == touch


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
    touch, grip = Touch(4.2, 0.26, 0.32, 0.26, 0.01), np.array([0.01, 0.02, np.pi / 2])
    seen = measured_touch(affected(name, **values), touch, grip, grip)
    assert seen.time - touch.time == pytest.approx(time)
    assert seen.x - touch.x == pytest.approx(x)
    assert seen.to_fixed == seen.x
    assert seen.to_grasped - 0.33 == pytest.approx(to_grasped)
