"""A plant whose rig is not what the cell believes: gripper, desk, reports, camera."""

import numpy as np
import pytest

from drivers.strip.describe import describe
from drivers.strip.file import StripFile
from drivers.strip.grip_path import true_path
from drivers.strip.model import Effects
from drivers.strip.observation import seen_points
from drivers.twin.open import Twin, open_twin
from drivers.twin.renderer.optics import Optics
from drivers.twin.scene import Truth
from drivers.twin.settings import ArmSettings, CameraSettings, TwinSettings, WorldSettings
from drivers.types import Array, Pose, Velocity
from tests.support.effect_cases import LENGTH, denim
from tests.support.twin_moves import grasp, move, wait

QUIET = TwinSettings(
    arm=ArmSettings(noise=0.0, pitch_noise=0.0),
    world=WorldSettings(links=40),
    camera=CameraSettings(width=320, height=240),
)
EDGE = Pose(LENGTH, 0.0, 0.0)
OFFSETS = {
    "tcp_offset": {"x": 0.004, "z": -0.003},
    "gripper_tilt": {"angle": 0.08},
    "desk_height": {"height": 0.005},
}


def at_edge(effects: Effects, strip: StripFile | None = None) -> Twin:
    """A twin whose open hand reports to be at the strip's edge."""
    twin = open_twin(QUIET, strip or denim(), effects, seed=0)
    twin.arm.connect()
    move(twin, EDGE)
    return twin


def lift(effects: Effects, strip: StripFile | None = None, held: bool = True) -> tuple[Twin, Array]:
    """A twin whose arm lifted and carried; what it reported: times, x, z, pitch (k, 4)."""
    twin = at_edge(effects, strip)
    if held:
        grasp(twin)
    reports = []
    for _ in range(200):
        twin.arm.set_velocity(Velocity(-0.07, 0.07, 0.6))
        wait(twin, 0.01)
        state = twin.arm.state()
        reports.append([state.stamp, *state.pose.as_array()])
    twin.arm.stop()
    wait(twin, 0.3)
    return twin, np.array(reports)


def edge_at(truth: Truth, t: Array) -> Array:
    """True poses (k, 3) of the edge at times (k,)."""
    return np.stack([np.interp(t, truth.t, truth.edge[:, c]) for c in range(3)], axis=1)


@pytest.mark.parametrize("name", OFFSETS)
def test_edge_goes_where_the_reported_path_truly_leads(name: str) -> None:
    effects = {name: OFFSETS[name]}
    twin, reports = lift(effects)
    rig = describe(denim(), effects).rig
    t, poses = true_path(rig, reports[:, 0], reports[:, 1:])
    np.testing.assert_allclose(edge_at(twin.truth(), t), poses, atol=3e-4)
    assert np.abs(poses[-1] - reports[-1, 1:]).max() > 0.0029


@pytest.mark.parametrize("time", [0.04, 0.0125, -0.04])
def test_gripper_was_at_the_reported_place_a_delay_before(time: float) -> None:
    twin, reports = lift({"control_delay": {"time": time}})
    moving = reports[20:180]
    edge = edge_at(twin.truth(), moving[:, 0] - time)
    np.testing.assert_allclose(edge, moving[:, 1:], atol=1e-4)
    at_once = edge_at(twin.truth(), moving[:, 0])
    assert np.abs(at_once - moving[:, 1:])[:, 0].max() == pytest.approx(0.07 * abs(time), rel=0.2)


@pytest.mark.parametrize("error", [0.004, -0.004])
def test_strip_lies_at_its_own_length_and_is_taken_at_the_stated_one(error: float) -> None:
    strip = denim(effects={"length_error": {"error": error}})
    twin = open_twin(QUIET, strip, {}, seed=0)
    lying = twin.world.scene(0.0).points
    np.testing.assert_allclose(lying[-1], (LENGTH + error, 0.0))
    assert not lying[:, 1].any()
    twin, reports = lift({}, strip)
    np.testing.assert_allclose(
        edge_at(twin.truth(), reports[:, 0])[:, :2], reports[:, 1:3], atol=1e-4
    )


@pytest.mark.parametrize(("error", "held"), [(-0.003, True), (-0.008, False), (0.02, True)])
def test_fingers_hold_the_strip_where_there_is_one(error: float, held: bool) -> None:
    twin = at_edge({}, denim(effects={"length_error": {"error": error}}))
    twin.hand.grasp()
    wait(twin, 1.0)
    assert twin.hand.state().grasped == held


def test_camera_moved_since_its_calibration_shows_places_scaled_and_shifted() -> None:
    calibrated = Optics.of(CameraSettings())
    now = calibrated.displace(0.02, (0.004, -0.003))
    points = np.random.default_rng(1).uniform((0.0, 0.0, 0.0), (0.6, 0.05, 0.3), (50, 3))
    seen = 1.02 * points + (0.004, 0.0, -0.003)
    np.testing.assert_allclose(now.project(points), calibrated.project(seen), atol=1e-9)
    shift = {"scale": {"scale": 0.02}, "shift": {"x": 0.004, "z": -0.003}}
    model = describe(denim(), {f"homography_{name}": values for name, values in shift.items()})
    np.testing.assert_allclose(seen_points(model, points[:, ::2]), seen[:, ::2])
