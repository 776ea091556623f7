"""The emulated robot by the wall clock, with a clock that the test turns."""

from types import SimpleNamespace

import pytest

from drivers.fci_server import server as pace
from drivers.fci_server.server import RobotServer, ServerSettings


@pytest.fixture
def clock(monkeypatch) -> SimpleNamespace:
    wall = SimpleNamespace(now=100.0)
    wall.monotonic = lambda: wall.now
    monkeypatch.setattr(pace, "time", wall)
    return wall


def test_late_machine_still_gives_its_client_a_whole_period(clock) -> None:
    periods = pace.Pace()
    for late in (0.0, 0.0001, 0.003, 0.05, 0.0):
        clock.now += periods.remaining() + late
        periods.begin_next()
        assert 0.0008 - 1e-9 <= periods.remaining() <= 0.001 + 1e-9


def test_small_lateness_is_made_up_for(clock) -> None:
    periods, begun = pace.Pace(), clock.now
    for late in (0.0001, 0.00015, 0.00005) * 100:
        due = clock.now + periods.remaining()
        clock.now = due + late
        periods.begin_next()
    assert clock.now - begun == pytest.approx(0.3, abs=0.002)


def test_commands_for_earlier_ticks_do_not_hide_the_one_for_this_tick() -> None:
    with RobotServer(ServerSettings(lock_step=False)) as server:
        pass  # closed: nobody else reads its commands
    late = [SimpleNamespace(message_id=tick) for tick in range(7)]
    server._arm = SimpleNamespace(command=lambda: late.pop(0) if late else None)
    server.robot = SimpleNamespace(time=5, moving=True)
    assert server._next_command().message_id == 5
    assert server._next_command() is None
