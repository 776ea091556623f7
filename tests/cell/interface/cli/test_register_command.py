"""`cell register` from guiding the hand to the line in cell.yaml, by the robot's own
client.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("pylibfranka", reason="the robot's library is not installed")

from cell.base.config.places import Configs
from drivers.base.installation import Mounting
from drivers.base.types import frozen
from drivers.franka.inverse_kinematics import solve
from drivers.franka.kinematics import HOME
from drivers.franka.shapes import TIP_AHEAD
from drivers.twin.fci_server.posture import Posture
from drivers.twin.fci_server.server import RobotServer
from tests.support.commands import invoke

TRUE = Mounting(x=0.38, y=-0.28, z=0.11, yaw=1.55)
TOUCHED = ((0.0, 0.0), (0.6, 0.0), (0.3, -0.15))  # m, x and y in the cell


@pytest.fixture
def server() -> Iterator[RobotServer]:
    with RobotServer() as server:
        yield server


@pytest.fixture
def configs(configs: Path, server: RobotServer) -> Path:
    """Configurations whose robot is `server`."""
    fci = f"{{address: {server.address}, lock_step: true}}"
    with (configs / "cell.yaml").open("a") as file:
        file.write(f"\nfci: {fci}\n")
    return configs


def guide(server: RobotServer, place: tuple[float, float]) -> None:
    """Lead the hand, upright, until its fingers touch a point of the desk."""
    pose = TRUE.transform().to_robot(place[0], TIP_AHEAD, np.pi / 2)
    pose[:3, 3] += place[1] * TRUE.transform().matrix[:3, 1]
    robot = server.robot
    near = HOME + frozen([np.arctan2(pose[1, 3], pose[0, 3]), 0, 0, 0, 0, 0, 0])
    robot.posture = Posture.resting(solve(pose, near), robot.configuration.tool)


def test_three_touched_points_give_the_mounting_and_keep_the_old_one(
    server: RobotServer, configs: Path, monkeypatch
) -> None:
    old = Configs(configs).cell().installation.mounting
    asked: list[str] = []

    def touch(question: str) -> str:
        guide(server, TOUCHED[len(asked)])
        asked.append(question[:6])
        return "\n"

    monkeypatch.setattr("cell.interface.cli.arm.ask", touch)
    result = invoke(f"register --configs {configs}")
    assert result.exit_code == 0, result.exception
    assert asked == ["1 of 3", "2 of 3", "3 of 3"]
    found = Configs(configs).cell().installation.mounting
    for name in ("x", "y", "z", "yaw"):  # the wire carries float32
        assert getattr(found, name) == pytest.approx(getattr(TRUE, name), abs=2e-5)
    lines = (configs / "cell.yaml").read_text().splitlines()
    (kept,) = [line for line in lines if "# until" in line]
    assert f"x: {old.x}" in kept
    assert server.robot.ticks == 0  # it moved nothing by itself


def test_input_that_ended_is_no_touch(server: RobotServer, configs: Path) -> None:
    before = (configs / "cell.yaml").read_bytes()
    result = invoke(f"register --configs {configs}", input="\n\n")
    assert "the input ended before Enter was pressed" in str(result.exception)
    assert (configs / "cell.yaml").read_bytes() == before
