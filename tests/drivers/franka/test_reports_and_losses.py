"""Motions arrive whatever a robot reports of its rates, and however it goes on without
commands.
"""

import numpy as np
import pytest

from drivers.base.motion import TICK
from drivers.franka import limits
from drivers.franka.force import ForceGuard
from drivers.franka.joint_motion import follow_joints
from drivers.franka.kinematics import HOME
from drivers.franka.mailbox import CommandKind
from drivers.twin.fci_server.dynamics import RateReport
from drivers.twin.fci_server.faults import lost_commands
from tests.drivers.franka.rig import JOINTS, LossyRobot, begun

GOAL = HOME + 0.3 * np.array([1.0, 0.5, -0.3, 0.7, 0.1, 0.2, -1.0])
LOST = (0.0, 0.05, 0.12, 0.25)
SLOWER = 1.5  # times that of the way without losses, at most
REPORTS = [
    RateReport.ZERO,
    *(
        pytest.param(report, marks=pytest.mark.slow)
        for report in RateReport
        if report is not RateReport.ZERO
    ),
]
EVERY_WAY = [
    pytest.param(holds, share, id=f"{'held' if holds else 'gone-on'}-{share}")
    for holds in (False, True)
    for share in LOST
]


class Heard(LossyRobot):
    """Keeps the joints that it was commanded in each tick that it has heard."""

    def __init__(self, joints, report: RateReport, share: float, *, holds: bool):
        super().__init__(joints, reports=report, holds=holds)
        self.robot.losses = lost_commands(share, seed=3)
        self.heard = [np.array(joints)]

    def _command(self, joints: np.ndarray, last: bool) -> None:
        before = self.robot.motion
        super()._command(joints, last)
        if before is not None and before.missed == 0:
            self.heard.append(joints)


def go_home(report: RateReport, share: float, *, holds: bool) -> Heard:
    robot = Heard(HOME, report, share, holds=holds)
    follow_joints(robot, GOAL.tolist(), 1.0, ForceGuard(20.0), lambda _: False)
    return robot


@pytest.fixture(scope="module")
def undisturbed() -> int:
    """Ticks of the way without losses."""
    return go_home(RateReport.EXACT, 0.0, holds=False).robot.time


@pytest.mark.parametrize("report", REPORTS)
@pytest.mark.parametrize(("holds", "share"), EVERY_WAY)
def test_way_home_arrives_whatever_is_reported_and_lost(
    report: RateReport, holds: bool, share: float, undisturbed: int
) -> None:
    robot = go_home(report, share, holds=holds)
    assert robot.ended
    assert not robot.robot.errors
    assert robot.robot.posture.q == pytest.approx(GOAL, abs=1e-4)
    assert robot.robot.time <= SLOWER * undisturbed


@pytest.mark.parametrize("holds", [False, True])
def test_commands_that_are_heard_are_smooth(holds: bool) -> None:
    # one that holds hears them without those that were lost
    robot = go_home(RateReport.ZERO, 0.25 if holds else 0.0, holds=holds)
    path = np.array(robot.heard)
    rates = np.diff(path, axis=0) / TICK
    accelerations = np.diff(rates, axis=0) / TICK
    jerks = np.diff(accelerations, axis=0) / TICK
    assert (np.abs(rates) <= np.array(limits.FR3.velocity)).all()
    assert (np.abs(accelerations) <= limits.ACCELERATION).all()
    assert (np.abs(jerks) <= limits.JERK).all()


@pytest.mark.slow
@pytest.mark.parametrize("report", [RateReport.LATE, RateReport.ZERO])
@pytest.mark.parametrize(("holds", "share"), EVERY_WAY)
def test_hand_follows_velocities_and_comes_to_rest_whatever_is_lost(
    report: RateReport, holds: bool, share: float
) -> None:
    robot = Heard(JOINTS, report, share, holds=holds)
    setup = begun(robot)
    for vx, vz, turn in ((-0.1, 0.1, 1.2), (-0.15, 0.0, 0.3), (0.0, 0.1, -0.5)):
        setup.order(CommandKind.FOLLOW, vx, vz, turn)
        setup.steps(60)
    setup.loop.end()
    assert robot.ended
    assert not robot.robot.errors
