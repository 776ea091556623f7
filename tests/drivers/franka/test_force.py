"""Forces beyond what a real arm feels at rest: tare, guards, drift, retreat."""

import time
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("pylibfranka", reason="the robot's library is not installed")

from drivers.base.errors import Fault
from drivers.base.motion import TICK
from drivers.base.types import Array
from drivers.franka.collision import BoxObstacle, Solids
from drivers.franka.failure import ArmFault, Cause
from drivers.franka.force import DriftMonitor, ForceGuard, OwnTorques, Tare
from drivers.franka.joint_requests import GoTo, go_to, retreat
from drivers.franka.kinematics import HOME
from drivers.franka.limits import FR3
from drivers.franka.mailbox import CommandKind
from drivers.franka.model import ArmModel
from drivers.franka.obstacles import solids_of
from drivers.franka.settings import FciSettings
from drivers.twin.fci_server.faults import ModelFault
from tests.drivers.franka.rig import (
    COLLISION,
    INSTALLATION,
    JOINTS,
    LossyRobot,
    begun,
    near,
    served,
    task,
)

OFFSET = [2.0, -3.0, 4.0, 0.5, 0.0, 0.1]  # N, N m, at rest and touching nothing
TORQUES = [0.5, -1.0, 0.2, 0.0, 0.1, 0.0, 0.0]
TARE = Tare(tuple(OFFSET), tuple(TORQUES))
NAN = float("nan")
TIGHT = FciSettings().collision.force_upper  # N
STIFF = 2000.0  # N/m
SOLIDS = solids_of(INSTALLATION)


def state(force=(0.0, 0.0, 0.0), torques=(0.0,) * 7) -> SimpleNamespace:
    """What a robot with that offset reports under a force and torques."""
    wrench = [a + b for a, b in zip(OFFSET, (*force, 0, 0, 0), strict=True)]
    together = [a + b for a, b in zip(TORQUES, torques, strict=True)]
    return SimpleNamespace(O_F_ext_hat_K=wrench, tau_ext_hat_filtered=together)


def test_tare_is_the_mean_of_forces_at_rest() -> None:
    tare = Tare.from_states([state((0.0, 0.0, 1.0)), state((0.0, 0.0, -1.0))], 10.0)
    assert tare.wrench == pytest.approx(OFFSET)
    assert tare.torques == pytest.approx(TORQUES)


@pytest.mark.parametrize("force", [(0.0, 0.0, 20.0), (NAN, 0.0, 0.0)])
def test_what_presses_at_rest_is_not_tared_away(force) -> None:
    with pytest.raises(ArmFault) as failed:
        Tare.from_states([state(force)] * 3, 10.0)
    assert failed.value.cause is Cause.PRESSED


@pytest.mark.parametrize("moment", [0, 1, 2])
def test_moment_that_is_no_number_is_not_tared_away(moment: int) -> None:
    broken = state()
    broken.O_F_ext_hat_K[3 + moment] = NAN
    with pytest.raises(ArmFault, match="no numbers"):
        Tare.from_states([state(), broken], 10.0)


@pytest.mark.parametrize(("felt", "share"), [(0.6, 0.6), (3.0, 1.0), (-3.0, -1.0)])
def test_no_more_than_the_arm_s_own_weight_is_taken_for_it(felt, share) -> None:
    model = ArmModel()
    own = OwnTorques(model, HOME, felt * model.torques(HOME))
    assert own.share == pytest.approx(share)


def test_guards_hold_beyond_the_tare_and_in_every_direction() -> None:
    guard = ForceGuard(15.0, 10.0, TARE)
    assert guard.beyond_tare(state())[:3] == pytest.approx([0.0, 0.0, 0.0])
    for axis in (*np.eye(3), *-np.eye(3)):
        assert guard.objection(state(14.0 * axis)) == ""
        assert "met 16.0 N, allowed 15.0 N" in guard.objection(state(16.0 * axis))


@pytest.mark.parametrize("joint", range(7))
def test_push_on_the_arm_itself_is_felt_by_its_joint(joint: int) -> None:
    push = np.zeros(7)

    def objection() -> str:
        return ForceGuard(15.0, 10.0, TARE).objection(state(torques=push))

    push[joint] = -11.0
    assert f"joint {joint + 1} met 11.0 N m" in objection()
    push[joint] = -8.8
    assert objection() == ""
    push[joint] = NAN
    assert f"joint {joint + 1} met nan N m" in objection()
    with pytest.raises(ArmFault, match="no numbers"):
        Tare.from_states([state(torques=push)] * 3, 10.0)


def test_torques_that_alternate_are_no_push_and_one_that_stays_is_felt_soon() -> None:
    guard, shaking = ForceGuard(15.0, 10.0, TARE), np.zeros(7)
    for sign in 20 * (1.0, -1.0):
        shaking[6] = 9.0 * sign
        assert guard.objection(state(torques=shaking)) == ""
    shaking[6] = 20.0
    felt = [bool(guard.objection(state(torques=shaking))) for _ in range(8)]
    assert felt[-1]


@pytest.mark.parametrize("share", [-0.1, 0.05, 1.0])
@pytest.mark.parametrize("push", [0.0, -16.0, 16.0])
def test_swing_by_a_wrong_model_is_no_push_and_hides_none(
    share: float, push: float
) -> None:
    """The estimate holds a share of what holds and moves the arm."""
    model, way = ArmModel(), np.array([0.3, 0.8, 0.0, 0.9, 0.0, 0.0, 0.0])

    def estimate(time: float, push: float = 0.0) -> SimpleNamespace:
        along, across = way * np.cos(5.0 * time), way * np.sin(5.0 * time)
        q, rate, change = HOME + way - along, 5.0 * across, 25.0 * along
        torques = share * model.torques(q, rate, change)
        torques[3] += push
        return SimpleNamespace(
            time=SimpleNamespace(to_sec=lambda: time),
            q=q.tolist(),
            dq=rate.tolist(),
            O_F_ext_hat_K=[0.0] * 6,
            tau_ext_hat_filtered=torques,
        )

    rest = estimate(0.0)
    rest.tau_ext_hat_filtered = share * model.torques(HOME)
    guard = ForceGuard(15.0, 15.0, Tare.from_states([rest] * 3, 10.0, ArmModel()))
    for tick in range(1, 600):
        assert guard.objection(estimate(tick * TICK)) == ""
    felt = [guard.objection(estimate(0.6 + tick * TICK, push)) for tick in range(20)]
    assert any("joint 4" in objection for objection in felt) is (push != 0.0)


@pytest.mark.parametrize("share", [0.1, 1.0])
def test_whole_swing_of_a_robot_with_a_wrong_model_meets_nothing(share: float) -> None:
    wrong = ModelFault(kind="wrong_model", at=0, share=share)
    with served(faults=[wrong]) as server:
        go_to(task(server, guard_torque=1.0), GoTo(near(0.6), 1.0))
        assert server.robot.posture.q == pytest.approx(near(0.6), abs=1e-3)


def test_loop_guards_and_reports_force_beyond_the_tare() -> None:
    setup = begun(guard=TARED)
    robot = setup.robot
    robot.force, robot.torques = OFFSET, TORQUES
    setup.order(CommandKind.FOLLOW, -0.1, 0.0, 0.0)
    report = setup.steps(50)
    assert (report.fx, report.fz) == pytest.approx((0.0, 0.0), abs=1e-9)
    robot.torques = [*TORQUES[:3], 20.0, *TORQUES[4:]]
    setup.steps(200)
    halted = setup.loop.halted
    assert halted.cause is Cause.CONTACT
    assert "joint 4" in halted.words


TARED = ForceGuard(15.0, 15.0, TARE)


@pytest.fixture
def leant():
    """What a new monitor objects to a force [N] on the arm's side for some ticks."""
    drift = DriftMonitor(TARED, 8.0, TICK)

    def objections(force: float, ticks: int, *, moving: bool = False) -> list[str]:
        felt = state((0.0, force, 0.0))
        told = (drift.objection(felt, moving=moving) for _ in range(ticks))
        return [*filter(None, told)]

    return objections


def test_force_that_stays_at_rest_is_drift_and_one_in_motion_is_not(leant) -> None:
    assert not leant(7.0, 5000)
    assert not leant(9.0, 5000, moving=True)
    assert not leant(9.0, 300)  # it settles
    assert "drifted to 8.0 N, allowed 8.0 N" in leant(9.0, 3000)[0]


def test_force_of_an_earlier_rest_does_not_count_in_the_next(leant) -> None:
    assert not leant(7.9, 3000)
    assert not leant(7.9, 1, moving=True)
    assert not leant(9.0, 900)


def test_drift_at_rest_ends_the_motion() -> None:
    setup = begun()
    setup.robot.force = [0.0, 0.0, -10.0, 0.0, 0.0, 0.0]
    setup.steps(3000)
    assert "drifted" in setup.loop.halted.words


class Wall:
    """A spring in which the gripper stands, 20 N deep."""

    def __init__(self) -> None:
        self.edge: float | None = None

    def force(self, tip, time):
        if self.edge is None:
            self.edge = tip[1, 3] - 20.0 / STIFF
        return np.array([0.0, -STIFF * max(tip[1, 3] - self.edge, 0.0), 0.0])


def felt(server) -> None:
    """Wait until the server's robot has felt what is around it."""
    end = time.monotonic() + 30.0
    while not server.robot.contact.wrench.any() and time.monotonic() < end:
        server.robot.rest()


def test_arm_that_is_pressed_does_not_go_home_by_itself_and_retreats_when_asked_to():
    with served(push=Wall().force) as server:
        robot = server.robot
        felt(server)
        with pytest.raises(Fault, match=r"feels 20\.0 N at rest.*--recover") as fault:
            go_to(task(server), GoTo(near(-0.1), 1.0))
        assert fault.value.name == "arm_pressed"
        assert robot.ticks == 0
        go_to(task(server), GoTo(near(-0.1), 1.0, recover=True))
        assert robot.posture.q == pytest.approx(near(-0.1), abs=1e-3)
        thresholds = robot.configuration.thresholds
        assert thresholds.force_nominal[1, 0] == COLLISION.force_upper  # tight again


class Pressed(LossyRobot):
    """A robot that loses nothing, with a force on its gripper that depends on where
    that is.
    """

    def __init__(self, push, joints=JOINTS) -> None:
        super().__init__(joints)
        self.pressing = push
        self.begin = self.place
        self.thresholds: list[float] = []

    @property
    def place(self) -> np.ndarray:
        return self.posture.reached[:3, 3].copy()

    @property
    def moved(self) -> np.ndarray:
        return self.place - self.begin

    def state(self) -> SimpleNamespace:
        return self.read(None)

    def read(self, motion: object) -> SimpleNamespace:
        found = super().read(motion)
        found.O_F_ext_hat_K = [0.0, self.pressing(self.moved[1]), 0.0, 9.0, 0.0, 0.0]
        return found

    def configure(self, collision) -> None:
        self.thresholds.append(collision.force_upper)


def _retreat(robot: Pressed, solids: Solids = SOLIDS) -> None:
    retreat(robot, FciSettings(), lambda: False, solids)


def _solid(name: str, low: Array, high: Array) -> Solids:
    return Solids(np.eye(4), (BoxObstacle(name, tuple(low), tuple(high)),))


def _wall(y: float) -> Solids:
    """A wall across the arm's side, 1 m thick from `y` [m] on."""
    return _solid("wall", (-3.0, y, -3.0), (3.0, y + 1.0, 3.0))


def refused(match: str, robot: Pressed, solids: Solids = SOLIDS) -> Cause:
    """Cause with which a retreat is refused, or ends without success."""
    with pytest.raises(ArmFault, match=match) as failed:
        _retreat(robot, solids)
    return failed.value.cause


def _springs_back(y: float) -> float:
    """Force [N] of a spring that is free 10 mm away."""
    return -max(20.0 + STIFF * y, 0.0)


def test_retreat_leaves_a_contact_along_its_force_and_no_further() -> None:
    robot = Pressed(_springs_back)
    _retreat(robot)
    assert -0.02 < robot.moved[1] < -0.008
    assert np.abs(robot.moved[[0, 2]]).max() < 1e-3
    assert robot.ended
    assert robot.thresholds[0] > 20.0 + 8.0


def test_retreat_that_frees_nothing_ends_after_its_way() -> None:
    robot = Pressed(lambda _: -20.0)  # somebody who follows
    said = r"still feels 20\.0 N after a retreat of 30 mm"
    assert refused(said, robot) is Cause.PRESSED
    assert robot.moved == pytest.approx([0.0, -0.03, 0.0], abs=2e-3)
    assert robot.ended
    assert robot.thresholds[-1] == TIGHT


def test_retreat_is_not_begun_where_a_joint_is_at_its_end() -> None:
    robot = Pressed(lambda _: -20.0, [*JOINTS[:6], FR3.upper[6] - 0.01])
    refused("a joint is at its end; free the arm by hand", robot)
    assert robot.ticks == 0


def test_retreat_ends_where_the_force_rises() -> None:
    # clamped: it grows along the way out
    robot = Pressed(lambda y: -20.0 + 2 * STIFF * y)
    refused(r"met 28\.\d N, allowed 28\.0 N", robot)
    assert -0.003 < robot.moved[1] < 0.0
    assert robot.thresholds[-1] == TIGHT  # tight again


def test_force_that_is_no_number_begins_no_retreat_and_ends_one() -> None:
    robot = Pressed(lambda _: NAN)
    assert refused("a force that is no number", robot) is Cause.PRESSED
    assert not robot.thresholds
    assert robot.ticks == 0
    robot = Pressed(lambda y: -20.0 if y > -0.005 else NAN)
    refused("met nan N", robot)
    assert robot.moved[1] > -0.01


@pytest.mark.parametrize(
    ("room", "free"), [(0.1, True), (0.031, False), (-0.01, False)]
)
def test_retreat_does_not_lead_towards_obstacles(room: float, free: bool) -> None:
    """A wall beside the arm, `room` [m] from it: what comes nearer is not begun."""
    robot = Pressed(_springs_back)
    edge = robot.place[1] - 1.0
    far = _wall(edge - 1.0)
    edge += float(far.clearance(np.array(JOINTS))[0]) - room
    wall = _wall(edge - 1.0)
    if free:
        _retreat(robot, wall)
        assert robot.ended
        return
    refused("leads towards the wall; free the arm by hand", robot, wall)
    assert robot.ticks == 0


def test_retreat_does_not_lead_past_an_obstacle_that_its_end_is_far_from() -> None:
    robot = Pressed(_springs_back)
    corner = robot.place + np.array([0.023, -0.012, 0.0])
    refused("towards the pin", robot, _solid("pin", corner, corner + 0.002))


def test_retreat_from_an_obstacle_may_begin_too_near() -> None:
    robot = Pressed(_springs_back)
    edge = robot.place[1] - 0.02
    wall = _wall(edge)
    _retreat(robot, wall)
    assert robot.ended


def test_arm_that_nothing_presses_does_not_retreat() -> None:
    robot = Pressed(lambda _: 2.0)
    _retreat(robot)
    assert not robot.thresholds
    assert robot.ticks == 0
