"""An arm that is off, under a cell that knows it: reports and commands are true."""

from collections.abc import Mapping

import numpy as np
import pytest

from cell.base.devices.rig_correction import CorrectedArm
from drivers.base.types import Pose, Velocity
from drivers.strip.describe import describe
from drivers.twin.open import Twin, open_twin
from drivers.twin.settings import (
    ArmSettings,
    CameraSettings,
    TwinSettings,
    WorldSettings,
)
from tests.support.effect_cases import denim
from tests.support.twin_moves import Steps

Values = Mapping[str, float]
FELT: list[tuple[str, Values]] = [
    ("tcp_offset", {"x": 0.004, "z": -0.003}),
    ("gripper_tilt", {"angle": 0.08}),
    ("desk_height", {"height": -0.003}),
    ("control_delay", {"time": 0.03}),
    ("control_delay", {"time": -0.03}),
]
QUIET = TwinSettings(
    arm=ArmSettings(noise=0.0, pitch_noise=0.0),
    world=WorldSettings(links=40),
    camera=CameraSettings(width=320, height=240),
)


def _affected(name: str, values: Values) -> tuple[Twin, CorrectedArm]:
    """A twin with the effect, and its arm as the cell that knows it sees it."""
    twin = open_twin(QUIET, denim(effects={name: values}), seed=0)
    arm = CorrectedArm(twin.arm, twin.hand, describe(denim(), {name: values}).rig)
    arm.connect()
    return twin, arm


def _go(twin: Twin, arm: CorrectedArm, pose: Pose, time: float) -> None:
    """To `pose` by `time`, asked for its state on the way as a control loop does."""
    clock = twin.clock
    arm.move_to(pose)
    while clock.now() < time:
        clock.wait_until(clock.now() + 0.01)
        arm.state()


@pytest.mark.parametrize(("name", "values"), FELT)
def test_corrected_arm_reports_where_the_edge_truly_is(
    name: str, values: Values
) -> None:
    """To 0.15 mm and 2 mrad in steady motion; a late arm guesses 4 mm beside where it
    turns.
    """
    twin, arm = _affected(name, values)
    wait_until = twin.clock.wait_until
    arm.move_to(Pose(0.6, 0.0, 0.0))
    wait_until(2.0)
    twin.hand.grasp()
    wait_until(3.0)
    told, steps = [], Steps(twin.world)
    for k in range(250):
        arm.set_velocity(Velocity(-0.05, 0.07 if k < 180 else -0.07, 0.6))
        wait_until(3.0 + 0.01 * (k + 1))
        state = arm.state()
        told.append([state.stamp, *state.pose.as_array(), state.velocity.vz])
    arm.stop()
    wait_until(6.0)
    truth, rows = steps.truth(), np.array(told)
    edge = [np.interp(rows[:, 0], truth.t, truth.edge[:, c]) for c in range(3)]
    off = np.abs(rows[:, 1:4].T - edge)
    turning = (rows[:, 0] < 3.2) | (np.abs(rows[:, 0] - 4.85) < 0.15)
    assert off[:2, ~turning].max() < 1.5e-4
    assert off[:2].max() < (1e-3 if values.get("time", 0.0) <= 0 else 4e-3)
    assert off[2, ~turning].max() < 2e-3
    if name != "control_delay":
        rising = (rows[:, 0] > 3.3) & (rows[:, 0] < 4.7)
        assert np.percentile(np.abs(rows[rising, 4] - 0.07), 98) < 1e-3


@pytest.mark.parametrize(("name", "values"), FELT)
def test_corrected_arm_goes_to_the_commanded_pose(name: str, values: Values) -> None:
    twin, arm = _affected(name, values)
    for time, pose in ((2.0, Pose(0.6, 0.0, 0.0)), (8.0, Pose(0.45, 0.2, 1.2))):
        _go(twin, arm, pose, time)
        twin.hand.grasp()
        twin.clock.wait_until(time + 1.0)
    again = Pose(0.4, 0.22, 1.4)
    _go(twin, arm, again, 12.0)
    assert not arm.state().moving
    np.testing.assert_allclose(
        twin.world.gripper.as_array(), again.as_array(), atol=2e-4
    )
    np.testing.assert_allclose(
        arm.state().commanded.as_array(), again.as_array(), atol=1e-9
    )
