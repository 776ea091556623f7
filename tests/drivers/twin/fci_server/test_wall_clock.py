"""The emulated robot by the wall clock, with a clock that the test turns."""

from types import SimpleNamespace

import pytest

from drivers.twin.fci_server import server as pace


@pytest.fixture
def clock(monkeypatch) -> SimpleNamespace:
    wall = SimpleNamespace(now=100.0)
    wall.monotonic = lambda: wall.now
    monkeypatch.setattr(pace, "time", wall)
    return wall


def test_late_machine_still_gives_its_client_a_whole_period(clock) -> None:
    periods = pace.PeriodTimer()
    for late in (0.0, 0.0001, 0.003, 0.05, 0.0):
        clock.now += periods.remaining() + late
        periods.begin_next()
        assert 0.0008 - 1e-9 <= periods.remaining() <= 0.001 + 1e-9


def test_small_lateness_is_made_up_for(clock) -> None:
    periods, begun = pace.PeriodTimer(), clock.now
    for late in (0.0001, 0.00015, 0.00005) * 100:
        due = clock.now + periods.remaining()
        clock.now = due + late
        periods.begin_next()
    assert clock.now - begun == pytest.approx(0.3, abs=0.002)
