"""What reaches the robot over the network, whatever the cell asks for."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

pytest.importorskip("pylibfranka", reason="the robot's library is not installed")

from cell.base.config.places import find_configs
from cell.base.devices.fci import fci_arm, start_joints
from drivers.base.errors import Fault
from drivers.base.motion import TICK
from drivers.base.types import Pose, Velocity, frozen
from drivers.franka import limits as robot
from drivers.franka.kinematics import forward
from drivers.franka.plane import StripPlane
from drivers.twin.clock import TwinClock
from drivers.twin.fci_server.server import RobotServer

pytestmark = pytest.mark.slow

CELL = find_configs(None).cell()
INSTALLATION = CELL.fci.limit(CELL.installation)
BOX = INSTALLATION.workspace
SLACK = 1.0 + 1e-3
# of velocity, acceleration, jerk: 1e-12 m over 1 ms ticks
ROUNDING = np.array([5e-6, 5e-3, 5.0])


def within(span: tuple[float, float]) -> st.SearchStrategy:
    return st.floats(*span)


def up_to(axis) -> st.SearchStrategy:
    return st.floats(-axis.velocity, axis.velocity)


MOVES = st.builds(Pose, within(BOX.x), within(BOX.z), within(BOX.pitch))
DRIVES = st.builds(Velocity, *(up_to(axis) for axis in INSTALLATION.limits.axes))
WAITS = st.sampled_from([0.002, 0.01, 0.05, 0.15, 0.4])
ORDERS = st.lists(st.tuples(MOVES | DRIVES | st.none(), WAITS), min_size=1, max_size=8)


class Told:
    """A robot that keeps what it is told, and an arm that tells it."""

    def __init__(self) -> None:
        joints = start_joints(INSTALLATION, CELL.fold, 0.6)
        self.poses: list[np.ndarray] = []
        self.clock = TwinClock()
        self.server = RobotServer(start=frozen(joints))
        follow, poses = self.server._follow, self.poses
        self.server._follow = lambda told: (poses.append(forward(told.q)), follow(told))
        self.arm, _ = fci_arm(CELL, self.clock, self.server.start().address)
        self.arm.connect()

    def obey(self, orders) -> None:
        """Give each order and let its time pass; stop where the arm has braked for
        good.
        """
        for order, wait in orders:
            match order:
                case Pose():
                    self.arm.move_to(order)
                case Velocity():
                    self.arm.set_velocity(order)
                case None:
                    self.arm.stop()
            self.clock.wait_until(self.clock.now() + wait)
            self.arm.state()

    def close(self) -> None:
        self.arm.close()
        self.server.close()


@given(orders=ORDERS)
@settings(max_examples=8, deadline=None, suppress_health_check=list(HealthCheck))
def test_no_command_on_the_wire_exceeds_a_limit(orders) -> None:
    told = Told()
    outcome = ""
    try:
        told.obey(orders)
    except Fault as fault:
        outcome = fault.name
    finally:
        told.close()
    # The arm may refuse to go on by itself, but never because the robot had to stop it.
    assert outcome in ("", "arm_out_of_reach", "arm_cell_silent")
    assert not told.server.robot.reasons
    assert (robot.FR3.margins(told.server.robot.posture.q) > 0).all()
    _check_course(told.poses)


def _check_course(poses: list[np.ndarray]) -> None:
    turned = StripPlane(INSTALLATION.mounting.transform())
    places = np.array([turned.to_cell(pose.T.ravel().tolist()) for pose in poses])
    places = np.concatenate([np.repeat(places[:1], 4, axis=0), places])
    low, high = np.array(BOX.low), np.array(BOX.high)
    assert (places >= low - 1e-6).all()
    assert (places <= high + 1e-6).all()
    axes = INSTALLATION.limits.axes
    allowed = [
        [axis.velocity for axis in axes],
        [axis.acceleration for axis in axes],
        [axis.jerk for axis in axes],
    ]
    for order, limit in enumerate(allowed):
        seen = np.abs(np.diff(places, order + 1, axis=0)) / TICK ** (order + 1)
        assert (seen <= SLACK * np.array(limit) + ROUNDING[order]).all(), (
            order,
            seen.max(0),
        )
