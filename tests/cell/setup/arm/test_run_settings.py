"""What a robot that can hurt demands."""

import pytest

from cell.base.config.drivers import Driver
from cell.setup.arm.run_settings import slow_down
from tests.support.requests import CELL


def at(address: str | None, arm: str = "fci"):
    fci = CELL.fci.model_copy(update={"address": address})
    return CELL.model_copy(update={"fci": fci}).with_drivers(arm)


@pytest.mark.parametrize(
    ("address", "real"),
    [(None, False), ("127.77.0.1", False), ("localhost", False), ("172.16.0.2", True)],
)
def test_only_a_robot_on_another_machine_is_real(address, real) -> None:
    assert at(address).has_real_arm is real
    assert not at(address, "twin").has_real_arm


@pytest.mark.parametrize("real", [True, False])
def test_arm_of_a_plug_in_is_real_unless_it_says_otherwise(monkeypatch, real) -> None:
    monkeypatch.setattr(type(CELL), "arm_driver", Driver("own:arm", real=real))
    for address in (None, "127.77.0.1", "172.16.0.2"):
        assert at(address).has_real_arm is real


def test_first_runs_go_at_a_tenth_of_the_speed_and_have_the_time_for_it() -> None:
    slow = slow_down(CELL)
    assert slow.fold.speed == pytest.approx(0.1 * CELL.fold.speed)
    for axis, full in zip(
        slow.installation.limits.axes, CELL.installation.limits.axes, strict=True
    ):
        assert axis.velocity == pytest.approx(0.1 * full.velocity)
        assert axis.acceleration == full.acceleration
    assert slow.monitors.duration > CELL.monitors.duration
