"""A plant whose rig is not what the cell believes: gripper, desk, reports, camera."""

import numpy as np
import pytest

from drivers.base.types import Pose, Velocity
from drivers.strip.describe import describe
from drivers.strip.file import StripFile
from drivers.strip.observation import measured_points
from drivers.twin.open import Twin, open_twin
from drivers.twin.renderer.optics import Optics
from drivers.twin.settings import (
    ArmSettings,
    CameraSettings,
    TwinSettings,
    WorldSettings,
)
from tests.support.effect_cases import LENGTH, denim
from tests.support.twin_moves import Steps, grasp, move, wait

QUIET = TwinSettings(
    arm=ArmSettings(noise=0.0, pitch_noise=0.0),
    world=WorldSettings(links=40),
    camera=CameraSettings(width=320, height=240),
)


def at_edge(strip: StripFile) -> Twin:
    """A twin whose open hand reports to be at the strip's edge."""
    twin = open_twin(QUIET, strip, seed=0)
    twin.arm.connect()
    move(twin, Pose(LENGTH, 0.0, 0.0))
    return twin


@pytest.mark.parametrize("error", [0.004, -0.004])
def test_strip_lies_at_its_own_length_and_is_taken_at_the_stated_one(
    error: float,
) -> None:
    strip = denim(effects={"length_error": {"error": error}})
    twin = open_twin(QUIET, strip, seed=0)
    lying = twin.world.scene(0.0).points
    np.testing.assert_allclose(lying[-1], (LENGTH + error, 0.0))
    assert not lying[:, 1].any()
    twin = at_edge(strip)
    grasp(twin)
    reports, steps = [], Steps(twin.world)
    for _ in range(200):
        twin.arm.set_velocity(Velocity(-0.07, 0.07, 0.6))
        wait(twin, 0.01)
        state = twin.arm.state()
        reports.append([state.stamp, state.pose.x, state.pose.z])
    truth, (t, *places) = steps.truth(), np.transpose(reports)
    for place, edge in zip(places, truth.edge.T, strict=False):
        np.testing.assert_allclose(np.interp(t, truth.t, edge), place, atol=1e-4)


@pytest.mark.parametrize(
    ("error", "held"), [(-0.003, True), (-0.008, False), (0.02, True)]
)
def test_fingers_hold_the_strip_where_there_is_one(error: float, held: bool) -> None:
    twin = at_edge(denim(effects={"length_error": {"error": error}}))
    twin.hand.grasp()
    wait(twin, 1.0)
    assert twin.hand.state().grasped == held


def test_camera_moved_since_its_calibration_shows_places_scaled_and_shifted() -> None:
    calibrated = Optics.from_settings(CameraSettings())
    now = calibrated.displace(0.02, (0.004, -0.003))
    points = np.random.default_rng(1).uniform(
        (0.0, 0.0, 0.0), (0.6, 0.05, 0.3), (50, 3)
    )
    seen = 1.02 * points + (0.004, 0.0, -0.003)
    np.testing.assert_allclose(now.project(points), calibrated.project(seen), atol=1e-9)
    shift = {"scale": {"scale": 0.02}, "shift": {"x": 0.004, "z": -0.003}}
    model = describe(
        denim(), {f"homography_{name}": values for name, values in shift.items()}
    )
    np.testing.assert_allclose(measured_points(model, points[:, ::2]), seen[:, ::2])
