"""Nothing is believed that can be read: tool, load, limits, errors, before each
motion.
"""

from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("pylibfranka", reason="the robot's library is not installed")

from drivers.base.errors import Fault
from drivers.base.readers import read_yaml
from drivers.base.types import frozen
from drivers.franka.checks import read_description, require_limits
from drivers.franka.failure import ArmFault
from drivers.franka.joint_requests import GoTo, go_to, hand_pose
from drivers.franka.kinematics import FLANGE_TO_TIP
from drivers.franka.limits import FR3
from drivers.franka.model import arm_urdf
from drivers.twin.fci_server.server import RobotServer
from drivers.twin.fci_server.wire import Reflex, RobotMode
from tests.drivers.franka.rig import arm_of, near, served, task
from tests.support.fci_clients import told_by

NARROWER = read_yaml(Path(__file__).with_name("narrower.yaml"))


@pytest.fixture
def left():
    """A robot whose last client has left a tool 50 mm longer with 1 kg."""
    with served() as server:
        told_by("left_behind.py", "pylibfranka", server.address)
        yield server


def refused(server: RobotServer, act) -> Fault:
    """How an act is refused that must not move the robot."""
    before, ticks = server.robot.posture.q, server.robot.ticks
    with pytest.raises(Fault) as fault:
        act()
    assert server.robot.ticks == ticks
    assert np.array_equal(server.robot.posture.q, before)
    return fault.value


def acts(server: RobotServer):
    """Everything that connects: the plane's motions, the way home, the touched
    points.
    """
    return (
        arm_of(server).connect,
        lambda: go_to(task(server), GoTo(near(), 1.0)),
        lambda: hand_pose(task(server)),
    )


def test_tool_and_load_left_by_another_program_are_refused_with_both_values(
    left,
) -> None:
    for act in acts(left):
        fault = refused(left, act)
        assert fault.name == "arm_tool_differs"
        for words in ("153.4) mm", "103.4) mm", "1.00 kg", "0.00 kg", "--reset-tool"):
            assert words in fault.reason


def test_tool_is_reset_where_that_is_asked_for_and_the_arm_then_goes_home(left) -> None:
    go_to(task(left), GoTo(near(0.0), 1.0, reset_tool=True))
    assert left.robot.configuration.load_mass == 0.0
    assert np.array_equal(left.robot.configuration.nominal_to_tool, np.eye(4))
    assert left.robot.posture.q == pytest.approx(near(0.0), abs=1e-4)
    with closing(arm_of(left)) as arm:
        arm.connect()


LONGER = FLANGE_TO_TIP @ np.block(
    [[np.eye(3), np.array([[0], [0], [0.05]])], [0, 0, 0, 1]]
)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"hand_mass": 0.9}, ("0.90 kg", "0.73 kg", "in Desk")),
        ({"hand_mass": float("nan")}, ("nan kg", "in Desk")),
        (
            {"hand_centre": frozen([0.0, 0.0, 0.06])},
            ("60.0) mm", "30.0) mm", "in Desk"),
        ),
        ({"flange_to_nominal": frozen(np.eye(4))}, ("0.0) mm", "103.4) mm", "in Desk")),
        ({"flange_to_nominal": frozen(LONGER)}, ("153.4) mm", "103.4) mm", "in Desk")),
        (
            {"tool_to_stiffness": frozen(np.diag([1.0, -1, -1, 1]))},
            ("180.0 deg", "0.0 deg"),
        ),
        ({"load_mass": 0.1}, ("0.10 kg", "0.00 kg", "--reset-tool")),
    ],
)
def test_each_property_of_the_tool_is_read(changes, words: tuple[str, ...]) -> None:
    with served() as server:
        server.robot.configuration = replace(server.robot.configuration, **changes)
        fault = refused(server, lambda: hand_pose(task(server)))
        assert fault.name == "arm_tool_differs"
        assert all(word in fault.reason for word in words)


def test_reset_cannot_override_what_desk_states() -> None:
    with served() as server:
        server.robot.configuration = replace(server.robot.configuration, hand_mass=0.9)
        fault = refused(
            server, lambda: go_to(task(server), GoTo(near(), 1.0, reset_tool=True))
        )
        assert fault.name == "arm_tool_differs"


def test_errors_of_a_robot_that_seems_idle_are_read() -> None:
    with served() as server:
        server.robot.errors = frozenset({Reflex.TAU_J_RANGE_VIOLATION})
        for act in acts(server)[:2]:
            fault = refused(server, act)
            assert fault.name == "arm_reflex"
            assert "tau_j_range_violation" in fault.reason


def test_robot_in_guiding_mode_is_not_moved() -> None:
    with served() as server:
        server.robot.mode = RobotMode.GUIDING
        assert (
            "not at rest and free, but in Guiding"
            in refused(server, acts(server)[1]).reason
        )


def test_robot_gives_the_description_that_its_client_reads() -> None:
    with served() as server:
        assert read_description(server.address) == arm_urdf()
    # nobody is there; the library says so
    assert read_description("127.254.254.1") is None


@pytest.mark.parametrize("name", NARROWER)
def test_robot_with_other_limits_than_those_of_the_plan_is_refused(name: str) -> None:
    old, new = NARROWER[name]
    assert old in arm_urdf()
    with pytest.raises(ArmFault, match=f"joint 1: {name} is") as failed:
        require_limits(arm_urdf().replace(old, new, 1), FR3)
    words = failed.value.words
    assert all(
        value.split('"')[1].rstrip("0").rstrip(".") in words for value in (old, new)
    )
    require_limits(arm_urdf(), FR3)


def test_robot_exchanged_after_the_plan_is_refused_before_anything_moves(
    monkeypatch,
) -> None:
    old, new = NARROWER["upper"]
    narrow = arm_urdf().replace(old, new, 1)
    monkeypatch.setattr(
        "drivers.twin.fci_server.arm_and_hand_ports.arm_urdf", lambda _: narrow
    )
    with served() as server:
        for act in acts(server):
            assert refused(server, act).name == "arm_limits_differ"
