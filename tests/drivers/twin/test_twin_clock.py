"""The twin's clocks: order, exactness, errors; and one that keeps step with the
wall.
"""

import pytest

import drivers.base.clock
from drivers.twin.clock import Rank, RealTimeClock, TwinClock


def test_periodic_events_do_not_drift() -> None:
    clock, times = TwinClock(), []
    clock.every(1 / 60, times.append, Rank.CAMERA)
    clock.wait_until(100.0)
    assert len(times) == 6000
    assert times[-1] == 100.0
    assert max(abs(t - (n + 1) / 60) for n, t in enumerate(times)) < 1e-9


class Wall:
    """The time module of a machine whose wall goes on by itself when told to."""

    def __init__(self) -> None:
        self.seconds = 50.0

    def monotonic(self) -> float:
        return self.seconds

    def sleep(self, seconds: float) -> None:
        self.seconds += seconds


@pytest.fixture
def wall(monkeypatch: pytest.MonkeyPatch) -> Wall:
    wall = Wall()
    monkeypatch.setattr(drivers.base.clock, "time", wall)
    return wall


def test_world_goes_on_only_when_the_wall_has(wall: Wall) -> None:
    twin = TwinClock()
    seen: list[tuple[float, float]] = []
    twin.every(0.5, lambda now: seen.append((now, wall.seconds)), Rank.WORLD)
    clock = RealTimeClock(twin)
    clock.wait_until(1.0)
    assert seen == [(0.5, 51.0), (1.0, 51.0)]
    assert clock.now() == twin.now() == pytest.approx(1.0)


def world_that_costs(twin: TwinClock, wall: Wall, share: float) -> None:
    """A world in which 0.1 s take `share` of that on the wall."""

    def labour(_: float) -> None:
        wall.seconds += 0.1 * share

    twin.every(0.1, labour, Rank.WORLD)


def test_catching_up_goes_on_until_the_world_is_at_the_present(wall: Wall) -> None:
    twin = TwinClock()
    world_that_costs(twin, wall, 0.5)
    clock = RealTimeClock(twin)
    clock.now()
    wall.seconds += 4.0
    clock.wait_until(0.1)
    assert clock.now() - twin.now() < 0.1
    assert clock.now() == pytest.approx(8.0, abs=0.2)


def test_world_slower_than_the_wall_falls_behind(wall: Wall) -> None:
    twin = TwinClock()
    world_that_costs(twin, wall, 4.0)
    clock = RealTimeClock(twin)
    clock.wait_until(1.0)
    assert clock.now() - twin.now() > 2.0
