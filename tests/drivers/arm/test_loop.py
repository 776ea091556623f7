"""The 1 kHz loop over a robot that goes where it is told."""

from dataclasses import dataclass
from multiprocessing import get_context

import numpy as np
import pytest

from drivers.arm.failure import Cause, Failed
from drivers.arm.latest import Latest, allocate
from drivers.arm.loop import Loop
from drivers.arm.messages import ORDER_LAYOUT, REPORT_LAYOUT, Kind, Order, Report
from drivers.arm.plane import StripPlane, matrix
from drivers.arm.reach import plan_reach
from drivers.arm.settings import FciSettings
from drivers.franka.tracking import rotation
from drivers.installation import Installation
from tests.drivers.arm.fake_robot import FakeRobot
from tests.drivers.arm.lossy_robot import LossyRobot

INSTALLATION = FciSettings().limit(Installation())
PLANE = INSTALLATION.mounting.transform()
START = (0.6, 0.15, 0.0)
PATH = np.array([START, (0.2, 0.2, 0.4)])
JOINTS = plan_reach(INSTALLATION, PATH, np.array([0.1, 0.1])).start.tolist()


@dataclass
class Setup:
    robot: FakeRobot
    loop: Loop
    orders: Latest
    reports: Latest
    number: int = 0
    beats: int = 0

    def order(self, kind: Kind, *values: float) -> None:
        self.number += 1
        self.beat(kind, *values)

    def beat(self, kind: Kind = Kind.HOLD, *values: float) -> None:
        self.beats += 1
        a, b, c = values or (0.0, 0.0, 0.0)
        self.orders.write(Order(self.number, kind, self.beats, a, b, c))

    def steps(self, count: int) -> Report:
        for _ in range(count):
            self.beats += 1
            self.orders.write(self.orders.read()._replace(beat=self.beats))
            self.loop.step()
        return self.reports.read()


def columns(pose: np.ndarray) -> list[float]:
    return pose.T.ravel().tolist()


@pytest.fixture
def setup() -> Setup:
    return begun(columns(StripPlane(PLANE).matrix(*START)))


def begun(pose: list[float], *, keep: bool = False) -> Setup:
    setup = begun_with(FakeRobot(pose, JOINTS))
    if not keep:
        setup.robot.written.clear()
    return setup


def begun_with(robot, *, lock_step: bool = True, guard=None) -> Setup:
    context = get_context("spawn")
    orders = Latest(allocate(ORDER_LAYOUT, context), Order, ORDER_LAYOUT)
    reports = Latest(allocate(REPORT_LAYOUT, context), Report, REPORT_LAYOUT)
    loop = Loop(
        robot,
        FciSettings(),
        INSTALLATION,
        orders,
        reports,
        lambda: 0.0,
        lock_step=lock_step,
        guard=guard,
    )
    loop.begin()
    return Setup(robot, loop, orders, reports)


def test_first_command_is_the_pose_that_the_robot_commands_itself() -> None:
    aside = StripPlane(PLANE).matrix(*START)
    aside[:3, 3] += [0.002, -0.001, 0.001]
    setup = begun(columns(aside), keep=True)
    assert setup.robot.written[0] == columns(aside)
    setup.loop.step()
    assert setup.robot.written[-1] == pytest.approx(columns(aside), abs=1e-15)


def test_arm_out_of_the_strip_s_plane_is_not_taken_over() -> None:
    aside = StripPlane(PLANE).matrix(*START)
    aside[0, 3] += 0.02
    with pytest.raises(Failed, match="beside the strip's plane") as failed:
        begun(columns(aside))
    assert failed.value.failure.cause is Cause.PLACE


@pytest.mark.parametrize("axis", [0, 2])
def test_hand_that_leans_out_of_the_plane_is_not_taken_over(axis: int) -> None:
    leaning = StripPlane(PLANE).matrix(*START)
    leaning[:3, :3] = leaning[:3, :3] @ rotation(0.1 * np.eye(3)[axis])
    with pytest.raises(Failed) as failed:
        begun(columns(leaning))
    assert failed.value.failure.cause is Cause.PLACE


def test_motion_ends_only_once_the_arm_rests() -> None:
    robot = LossyRobot(JOINTS, 1, 1, share=0.0)
    setup = begun_with(robot)
    setup.order(Kind.FOLLOW, -0.1, 0.1, 0.3)
    setup.steps(60)
    assert np.linalg.norm(robot.robot.posture.tool.velocity[:3]) > 0.05
    setup.loop.end()
    assert robot.ended
    assert not robot.robot.errors


def test_turned_hand_is_half_a_turn_about_its_own_axis() -> None:
    straight, turned = (StripPlane(PLANE, turned=t).matrix(*START) for t in (False, True))
    assert np.linalg.solve(straight, turned) == pytest.approx(np.diag([-1, -1, 1, 1]), abs=1e-12)
    assert StripPlane(PLANE, turned=True).to_cell(columns(turned)) == pytest.approx(START)


def test_hand_that_is_turned_is_taken_over_turned() -> None:
    turned = columns(StripPlane(PLANE, turned=True).matrix(*START))
    setup = begun(turned)
    setup.loop.step()
    assert setup.robot.written[0] == pytest.approx(turned, abs=1e-12)


def test_plane_and_mounting_agree_on_where_the_hand_is() -> None:
    for pose in ((0.6, 0.0, 0.0), (0.3, 0.2, 1.4), (0.0, 0.001, np.pi)):
        placed = PLANE.to_robot(*pose)
        assert StripPlane(PLANE).matrix(*pose) == pytest.approx(placed, abs=1e-12)
        assert StripPlane(PLANE).to_cell(columns(placed)) == pytest.approx(pose, abs=1e-12)


def test_loop_follows_orders_and_reports_what_it_measured(setup) -> None:
    setup.order(Kind.MOVE, 0.5, 0.2, 0.4)
    report = setup.steps(10)
    assert report.moving
    assert report.number == 1
    report = setup.steps(2000)
    assert not report.moving
    assert (report.x, report.z, report.pitch) == pytest.approx((0.5, 0.2, 0.4))
    assert report.ticks == 2010


@pytest.mark.parametrize(("lock_step", "reported"), [(True, 0), (False, 1)])
def test_on_the_robot_s_clock_the_answer_goes_out_before_the_report(
    lock_step: bool, reported: int
) -> None:
    setup = begun_with(
        FakeRobot(columns(StripPlane(PLANE).matrix(*START)), JOINTS), lock_step=lock_step
    )
    seen: list[tuple[int, int]] = []  # reports at each write and at each read
    begun, write, read = setup.reports.count, setup.robot.write_pose, setup.robot.read

    def written(*given, **named) -> None:
        seen.append((setup.reports.count - begun, 0))
        write(*given, **named)

    def asked(motion):
        seen.append((setup.reports.count - begun, 1))
        return read(motion)

    setup.robot.write_pose, setup.robot.read = written, asked
    setup.loop.step()
    assert seen == [(0, 0), (reported, 1)]
    assert setup.reports.count - begun == 1


def test_silent_cell_makes_the_arm_brake_for_good(setup) -> None:
    setup.order(Kind.MOVE, 0.2, 0.2, 0.0)
    setup.steps(300)
    for _ in range(600):
        setup.loop.step()
    assert setup.loop.halted is not None
    assert setup.loop.halted.cause is Cause.UNHEARD
    rest = setup.reports.read()
    setup.order(Kind.MOVE, 0.6, 0.2, 0.0)
    after = setup.steps(100)
    assert (after.x, after.z) == pytest.approx((rest.x, rest.z))


def test_silence_at_rest_is_no_failure(setup) -> None:
    for _ in range(1000):
        setup.loop.step()
    assert setup.loop.halted is None


def test_force_over_the_guard_brakes_and_is_named(setup) -> None:
    setup.order(Kind.FOLLOW, -0.1, 0.0, 0.0)
    setup.steps(50)
    setup.robot.force = [0.0, 0.0, 20.0, 0.0, 0.0, 0.0]
    setup.steps(200)
    assert setup.loop.halted is not None
    assert setup.loop.halted.cause is Cause.CONTACT
    assert "20.0 N" in setup.loop.halted.words
    assert not setup.reports.read().moving


def test_end_brakes_to_rest_and_finishes_the_motion(setup) -> None:
    setup.order(Kind.FOLLOW, -0.1, 0.0, 0.0)
    setup.steps(80)
    setup.loop.end()
    assert setup.robot.ended
    assert setup.robot.written[-1] == pytest.approx(setup.robot.written[-2], abs=1e-9)


def test_order_that_the_profile_refuses_is_a_failure_not_a_motion(setup) -> None:
    setup.order(Kind.FOLLOW, float("nan"), 0.0, 0.0)
    with pytest.raises(Failed) as failed:
        setup.loop.step()
    assert failed.value.failure.cause is Cause.COMMAND
    assert setup.robot.written == []


def test_matrix_of_columns_is_their_transpose() -> None:
    assert matrix(list(range(16)))[0].tolist() == [0, 4, 8, 12]
