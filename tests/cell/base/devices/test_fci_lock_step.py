"""The cell's time and the robot's in lock-step: what the wall clock does changes
nothing.
"""

import pytest

from cell.base.config.places import find_configs
from cell.base.devices.devices import Trial
from cell.base.devices.open import open_cell
from drivers.strip.describe import load_strip
from drivers.twin.fci_server import server
from drivers.twin.settings import CameraSettings
from tests.support.requests import CELL

pytest.importorskip("pylibfranka", reason="the robot's library is not installed")
STEPS = 90  # of 7 ms: not a multiple of the hand's period


def closing(
    monkeypatch: pytest.MonkeyPatch, waited: int
) -> list[tuple[float, float, bool]]:
    """Stamp, width and motion of a closing hand whose robot has `waited` [ms] for its
    client.
    """

    def resting(*arguments):
        robot = made(*arguments)
        robot.time = waited
        return robot

    made = server.resting_robot
    cell, configs = CELL.with_drivers("fci"), find_configs(None)
    twin = cell.twin.model_copy(
        update={"camera": CameraSettings(width=640, height=360)}
    )
    settings = cell.model_copy(update={"twin": twin})
    with monkeypatch.context() as patch:
        patch.setattr(server, "resting_robot", resting)
        strip = load_strip(configs.strip_path("denim"))
        devices = open_cell(settings, strip, Trial(), calibrating=False)
    try:
        devices.arm.connect()
        begun, seen = devices.clock.now(), []
        devices.hand.grasp()
        for step in range(1, STEPS):
            devices.clock.wait_until(begun + 0.007 * step)
            state = devices.hand.state()
            seen.append((state.stamp - begun, state.width, state.moving))
        return seen
    finally:
        devices.arm.close()
        devices.close()


@pytest.mark.slow
def test_how_long_the_robot_waited_for_its_client_shifts_no_state_of_the_hand(
    monkeypatch,
) -> None:
    once, later, latest = (closing(monkeypatch, waited) for waited in (0, 3, 1001))
    assert once == later == latest
    assert [moving for *_, moving in once][:: STEPS - 2] == [True, False]
