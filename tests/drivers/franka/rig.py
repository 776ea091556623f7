"""Robots that need no network, one that is served on loopback, and the loop that drives
them.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from drivers.base.installation import Installation
from drivers.base.types import frozen
from drivers.franka.arm import FciArm
from drivers.franka.force import ForceGuard
from drivers.franka.limits import FR3
from drivers.franka.loop import ServoLoop
from drivers.franka.mailbox import CommandKind, LoopCommand, Mailbox, Report
from drivers.franka.plane import StripPlane
from drivers.franka.process import RobotAccess
from drivers.franka.reach import ReachGuard, plan_reach
from drivers.franka.settings import CollisionSettings, FciSettings, HandLimits
from drivers.twin.clock import TwinClock
from drivers.twin.fci_server.configuration import Configuration
from drivers.twin.fci_server.dynamics import RateReport
from drivers.twin.fci_server.posture import Posture
from drivers.twin.fci_server.robot import MOST_MISSED_TICKS, EmulatedRobot
from drivers.twin.fci_server.server import RobotServer
from drivers.twin.fci_server.wire import MoveRequest, RobotCommand

JOINT_POSITION = 0
INSTALLATION = FciSettings().limit(Installation())
PLANE = INSTALLATION.mounting.transform()
START = (0.6, 0.15, 0.0)
PATH = np.array([START, (0.2, 0.2, 0.4)])
JOINTS = plan_reach(INSTALLATION, PATH, np.array([0.1, 0.1])).start.tolist()

COLLISION = CollisionSettings(
    torque_lower=21.0,
    torque_upper=31.0,
    force_lower=22.0,
    force_upper=32.0,
    moment_lower=13.0,
    moment_upper=23.0,
)


class FakeRobot:
    """Plays a robot that is at once where it is told to be, and keeps what it was
    told.
    """

    def __init__(self, joints: list[float] | None = None) -> None:
        self.joints = JOINTS if joints is None else joints
        self.measured: list[float] | None = None  # joints, where not as commanded
        self.force, self.torques = [0.0] * 6, [0.0] * 7
        self.written: list[list[float]] = []
        self.ended, self.clock = False, 0

    def start_joints(self) -> "FakeRobot":
        return self

    def read(self, motion: object) -> SimpleNamespace:
        self.clock += 1
        now = self.clock
        return SimpleNamespace(
            time=SimpleNamespace(to_sec=lambda: 1e-3 * now),
            **dict.fromkeys(("q_d", "tau_J"), self.joints),
            q=self.measured or self.joints,
            dq=[0.0] * 7,
            O_F_ext_hat_K=self.force,
            tau_ext_hat_filtered=self.torques,
            control_command_success_rate=1.0,
        )

    def write_joints(
        self, motion: object, joints: list[float], *, last: bool = False
    ) -> None:
        self.written.append(joints)
        self.joints = joints
        self.ended = last


class LossyRobot(EmulatedRobot):
    """Loses one command in ten, or what follows it, up to `worst` ticks at a time.

    A lost command is continued by the robot itself, by the rules of its server, so
    every limit holds that a robot would enforce. Fewer than MOST_MISSED_TICKS are lost
    in a row. States are rounded as on the wire.
    """

    def __init__(
        self,
        joints: Any,
        seed: int = 1,
        worst: int = 1,
        share: float = 0.0,
        reports: RateReport = RateReport.EXACT,
        *,
        holds: bool = False,
    ) -> None:
        at_rest = Posture.resting(np.array(joints), Configuration().tool)
        super().__init__(at_rest, holds=holds)
        self.reported.kind = reports
        self.lost, self.ended = 0, False
        self._rng = np.random.default_rng(seed)
        self._worst, self.share = worst, share
        self._in_a_row = 0
        self._heard, self._answered = False, True

    def start_joints(self) -> "LossyRobot":
        self.move(MoveRequest(1, JOINT_POSITION, (0.1,) * 6, False), 1)
        return self

    def write_joints(
        self, motion: object, joints: list[float], *, last: bool = False
    ) -> None:
        self._command(np.array(joints), last)

    def read(self, motion: object) -> SimpleNamespace:
        if not self._answered:
            self.miss()
            self.advance()
            self._in_a_row += 1
        self._answered = False
        posture, now = self.posture, self.time
        reported = self.reported.rates
        return SimpleNamespace(
            time=SimpleNamespace(to_sec=lambda: 1e-3 * now),
            q=rounded(posture.q),
            q_d=rounded(posture.q),
            dq_d=rounded(reported.velocity),
            ddq_d=rounded(reported.acceleration),
            O_F_ext_hat_K=[0.0] * 6,
            **dict.fromkeys(("dq", "tau_J", "tau_ext_hat_filtered"), [0.0] * 7),
            control_command_success_rate=float(self._heard),
        )

    def _command(self, joints: np.ndarray, last: bool) -> None:
        """Hear it or lose it, and lose the ticks after it or not."""
        self._answered = True
        if self._rng.random() >= self.share:
            self._heard = True
            self.receive(joint_command(self.time, joints, last))
            self.advance()
            self._in_a_row = 0
            lost = self._some() if self._rng.random() < self.share else 0
        else:
            lost = self._some()
        for _ in range(min(lost, MOST_MISSED_TICKS - 1 - self._in_a_row)):
            self.miss()
            self.advance()
            self.lost += 1
            self._in_a_row += 1
        self.ended = last

    def _some(self) -> int:
        return int(self._rng.integers(1, self._worst + 1))


def rounded(numbers: np.ndarray) -> list[float]:
    """As on the wire."""
    return np.float32(numbers).tolist()


def joint_command(time: int, joints: np.ndarray, last: bool = False) -> RobotCommand:
    return RobotCommand(time, joints, np.zeros(7), np.eye(4), np.zeros(6), None, last)


@dataclass
class Driven:
    """A loop over a robot, with what the cell would hold of it."""

    robot: Any
    loop: ServoLoop
    orders: Mailbox
    reports: Mailbox
    number: int = 0
    beats: int = 0

    def order(self, kind: CommandKind, *values: float) -> None:
        self.number += 1
        self.beats += 1
        self.orders.write(
            LoopCommand(self.number, kind, self.beats, *(values or (0.0, 0.0, 0.0)))
        )

    def steps(self, count: int) -> Report:
        for _ in range(count):
            self.beats += 1
            self.orders.write(self.orders.read()._replace(beat=self.beats))
            self.loop.step()
        return self.reports.read()


def begun(robot: Any = None, *, lock_step: bool = True, guard=None) -> Driven:
    """A loop at its start over `robot`, by default one that does what it is told."""
    robot = FakeRobot() if robot is None else robot
    boxes = Mailbox(LoopCommand), Mailbox(Report)
    settings = FciSettings(address="127.0.0.1", lock_step=lock_step)
    access, guard = (
        RobotAccess("", settings, INSTALLATION),
        guard or ForceGuard(settings.guard),
    )
    return Driven(robot, ServoLoop(robot, access, *boxes, lambda: 0.0, guard), *boxes)


def reach_guard(limits=FR3) -> ReachGuard:
    return ReachGuard(StripPlane(PLANE), INSTALLATION.limits, JOINTS, limits)


def columns(pose: np.ndarray) -> list[float]:
    return pose.T.ravel().tolist()


@contextmanager
def served(**given) -> Iterator[RobotServer]:
    """A robot at rest over the strip's edge, its hand homed and open."""
    with RobotServer(start=frozen(JOINTS), **given) as server:
        server.hand.width = HandLimits().opening
        yield server


def task(server: RobotServer, **changes) -> RobotAccess:
    """The robot as the cell drives it in lock-step."""
    settings = FciSettings(**({"collision": COLLISION} | changes))
    return RobotAccess(server.address, settings, INSTALLATION)


def arm_of(server: RobotServer, clock: TwinClock | None = None) -> FciArm:
    return FciArm(task(server), clock or TwinClock())


def near(shift: float = 0.05) -> list[float]:
    """Joints (7,) [rad] a little beside where a served robot stands."""
    return [JOINTS[0] + shift, *JOINTS[1:]]
