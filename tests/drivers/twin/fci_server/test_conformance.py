"""Clients that nobody here wrote drive the server, each in a process of its own, in
lock-step.

None of this was ever tried on a robot: it shows that server and client binaries agree.
"""

import numpy as np
import pytest

from drivers.twin.fci_server.faults import (
    ContactFault,
    DropFault,
    FreezeFault,
    ReflexFault,
    UserStopFault,
    VersionFault,
)
from drivers.twin.fci_server.robot import EmulatedRobot
from drivers.twin.fci_server.server import RobotServer, ServerSettings
from drivers.twin.fci_server.wire import Reflex
from tests.support.fci_clients import PACKAGES, told_by
from tests.support.fci_wire import RawArm

WALL = 0.03  # m along y


class Wall:
    """Pushes back with 25 N whoever comes beyond it."""

    def force(self, tip, time):
        return np.array([0.0, -25.0 if tip[1, 3] > WALL else 0.0, 0.0])


@pytest.mark.parametrize(
    ("script", "module"),
    [
        ("pylibfranka_client.py", "pylibfranka"),
        ("franky_client.py", "franky"),
        ("franka_rs_client.py", "franka"),
    ],
)
def test_client_moves_meets_a_wall_recovers_retreats_and_stops(
    script: str, module: str
) -> None:
    with RobotServer(push=Wall().force) as server:
        told = told_by(script, module, server.address)
        standing = server.robot.posture
    assert str(told["begun"]).lower() == "idle"
    assert told["moved"] == pytest.approx(0.02, abs=2e-4)
    mode, *reasons = told["reflex"]  # type: ignore[misc]
    assert mode.lower() == "reflex"
    assert reasons == ["cartesian_reflex"]
    assert str(told["recovered"]).lower() == "idle"
    assert str(told["stopped"]).lower() == "idle"
    assert standing.at_rest
    assert standing.reached[1, 3] < WALL


@pytest.mark.parametrize("module", PACKAGES)
def test_client_of_another_version_gets_the_version_in_its_reply(module: str) -> None:
    fault = VersionFault(at=0, kind="wrong_version", version=9)
    with RobotServer(faults=[fault]) as server:
        said = told_by("turned_away.py", module, server.address, module)["said"]
    assert "version" in str(said).lower()


class Flags:
    """Sets one error flag after another as the robot's time goes on."""

    robot: EmulatedRobot

    def force(self, tip, time):
        self.robot.errors = frozenset(
            {Reflex(int(1000 * time + 0.5) // 10 % len(Reflex))}
        )
        return np.zeros(3)


@pytest.mark.parametrize("module", ["pylibfranka", "franka"])
def test_each_error_flag_has_the_name_that_clients_read(module: str) -> None:
    flags = Flags()
    with RobotServer(push=flags.force) as server:
        flags.robot = server.robot
        names = told_by("error_flags.py", module, server.address, module)["names"]
    expected = [[reflex.name.lower()] for reflex in Reflex]
    # franka-rs adds a word to one of them
    assert [
        [name.removesuffix("_flag") for name in named] for named in names
    ] == expected  # type: ignore[attr-defined]


@pytest.mark.parametrize("module", PACKAGES)
def test_clients_hand_opens_grasps_and_is_refused_nonsense(module: str) -> None:
    with RobotServer(between=lambda: 0.02) as server:
        told = told_by("hand_client.py", module, server.address, module)
    assert told["opened"] is True
    assert told["grasped"] is True
    assert told["width"] == pytest.approx(0.02)
    assert told["holds"] is True
    assert told["missed"] is False
    assert told["stopped"] is True
    assert "Exception" in str(told["wide"]) or "Error" in str(told["wide"])


@pytest.mark.parametrize("module", PACKAGES)
def test_second_client_is_turned_away_at_once(module: str) -> None:
    with RobotServer() as server, RawArm(server.address) as first:
        said = told_by("turned_away.py", module, server.address, module)["said"]
        assert first.newest().mode == 1
    assert said != "connected"


@pytest.mark.parametrize(
    ("seconds", "said"), [(0.7, {"finished"}), (1.5, {"NetworkException"})]
)
def test_short_freeze_is_survived_and_a_long_one_named(
    seconds: float, said: set[str]
) -> None:
    fault = FreezeFault(at=100, kind="freeze", duration=seconds)
    with RobotServer(faults=[fault]) as server:
        told = told_by("long_drive.py", "pylibfranka", server.address, "300")
        assert told["said"] in said
        with RawArm(server.address) as arm:
            assert not any(arm.newest().dq)


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        (
            ReflexFault(at=50, kind="reflex", error="power_limit_violation"),
            "ControlException",
        ),
        (UserStopFault(at=50, kind="user_stop"), "ControlException"),
        (ContactFault(at=50, kind="contact", force=(0, 0, 25)), "ControlException"),
        (DropFault(at=50, kind="tcp_drop"), "NetworkException"),
    ],
)
def test_scripted_fault_reaches_the_makers_client_by_name(fault, said: str) -> None:
    with RobotServer(faults=[fault]) as server:
        told = told_by("long_drive.py", "pylibfranka", server.address, "300")
        assert server.robot.posture.at_rest
        assert server.robot.ticks in (50, 51)
    assert told["said"] == said
    assert float(str(told["seconds"])) < 4


def test_wall_clock_follows_a_client_that_keeps_up() -> None:
    with RobotServer(ServerSettings(lock_step=False)) as server:
        told = told_by("long_drive.py", "pylibfranka", server.address, "300")
        assert server.robot.posture.at_rest
    # a busy machine loses packets
    assert told["said"] in {"finished", "ControlException"}
    assert int(str(told["ticks"])) > 0
