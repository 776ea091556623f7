"""Motions arrive whatever a robot reports of its rates, and however it goes on without
commands.
"""

from collections.abc import Callable

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
PLACE = (0.45, 0.25, 0.6)  # m, m, rad
LOST = (0.0, 0.05, 0.12, 0.25)
SLOWER = 1.5  # times that of the way without losses, at most
LONGEST = 6000  # ticks
EVERY_WAY = [
    pytest.param(holds, share, id=f"{'held' if holds else 'gone-on'}-{share}")
    for holds in (False, True)
    for share in LOST
]


class Losing(LossyRobot):
    """Loses a share of the commands, and keeps how its joints move in each tick."""

    def __init__(self, joints, report: RateReport, share: float, *, holds: bool):
        super().__init__(joints, reports=report, holds=holds)
        self.losses = lost_commands(share, seed=3)
        self.rates = [self.posture.joints]

    def _command(self, joints: np.ndarray, last: bool) -> None:
        super()._command(joints, last)
        rates = self.posture.joints
        if rates is not self.rates[-1]:
            self.rates.append(rates)


Move = Callable[[RateReport, float, bool], Losing]


def by_joints(report: RateReport, share: float, holds: bool) -> Losing:
    robot = Losing(HOME, report, share, holds=holds)
    follow_joints(robot, GOAL.tolist(), 1.0, ForceGuard(20.0), lambda _: False)
    return robot


def by_hand(report: RateReport, share: float, holds: bool) -> Losing:
    robot = Losing(JOINTS, report, share, holds=holds)
    setup = begun(robot)
    setup.order(CommandKind.MOVE, *PLACE)
    while setup.steps(1).moving and robot.time < LONGEST:
        continue
    setup.loop.end()
    return robot


@pytest.fixture(scope="module", params=[by_joints, by_hand])
def move(request) -> Move:
    return request.param


@pytest.fixture(scope="module")
def undisturbed(move: Move) -> Losing:
    return move(RateReport.EXACT, 0.0, False)


@pytest.mark.parametrize(
    "report",
    [
        pytest.param(report, marks=pytest.mark.slow if number else ())
        for number, report in enumerate(reversed(RateReport))
    ],
)
@pytest.mark.parametrize(("holds", "share"), EVERY_WAY)
def test_motion_arrives_in_time_within_the_limits_whatever_is_reported_and_lost(
    move: Move, report: RateReport, holds: bool, share: float, undisturbed: Losing
) -> None:
    robot = move(report, share, holds)
    assert robot.ended
    assert not robot.errors
    assert robot.posture.q == pytest.approx(undisturbed.posture.q, abs=1e-4)
    assert robot.time <= SLOWER * undisturbed.time
    accelerations = np.array([rates.acceleration for rates in robot.rates[:-1]])
    velocities = np.array([rates.velocity for rates in robot.rates])
    jerks = np.diff(accelerations, axis=0) / TICK
    assert (np.abs(velocities) <= limits.FR3.velocity).all()
    assert (np.abs(accelerations) <= limits.ACCELERATION).all()
    assert (np.abs(jerks) <= limits.JERK).all()
