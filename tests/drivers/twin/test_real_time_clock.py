"""A twin's clock that keeps step with the wall."""

import pytest

import drivers.clock
from drivers.twin.clock import RealTimeClock, Turn, TwinClock


class Wall:
    """The time module of a machine whose wall goes on by itself when told to."""

    def __init__(self) -> None:
        self.seconds = 50.0
        self.slept: list[float] = []

    def monotonic(self) -> float:
        return self.seconds

    def sleep(self, seconds: float) -> None:
        self.slept.append(seconds)
        self.seconds += seconds


@pytest.fixture
def wall(monkeypatch: pytest.MonkeyPatch) -> Wall:
    wall = Wall()
    monkeypatch.setattr(drivers.clock, "time", wall)
    return wall


def test_world_goes_on_only_when_the_wall_has(wall: Wall) -> None:
    twin = TwinClock()
    seen: list[tuple[float, float]] = []
    twin.every(0.5, lambda now: seen.append((now, wall.seconds)), Turn.WORLD)
    clock = RealTimeClock(twin)
    clock.wait_until(1.0)
    assert seen == [(0.5, 51.0), (1.0, 51.0)]
    assert clock.now() == twin.now() == pytest.approx(1.0)


def test_time_before_the_first_use_does_not_count(wall: Wall) -> None:
    clock = RealTimeClock(TwinClock())
    wall.seconds += 30.0
    assert clock.now() == 0.0


def test_caller_that_comes_late_finds_the_world_at_the_present(wall: Wall) -> None:
    twin = TwinClock()
    clock = RealTimeClock(twin)
    clock.now()
    wall.seconds += 3.0
    clock.wait_until(1.0)
    assert wall.slept == []
    assert twin.now() == clock.now() == 3.0


def world_that_costs(twin: TwinClock, wall: Wall, share: float) -> None:
    """A world in which 0.1 s take `share` of that on the wall."""

    def labour(_: float) -> None:
        wall.seconds += 0.1 * share

    twin.every(0.1, labour, Turn.WORLD)


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


def test_a_patient_caller_is_kept_no_longer_than_allowed(wall: Wall) -> None:
    twin = TwinClock()
    twin.every(0.005, lambda _: cost(wall, 0.001), Turn.WORLD)
    clock = RealTimeClock(twin, patience=0.02)
    for tick in range(101):
        clock.wait_until(0.01 * tick)
    wall.seconds += 0.5
    begun = clock.now()
    clock.wait_until(1.01)
    assert clock.now() - begun <= 0.022
    assert 1.05 < twin.now() < 1.2
    for tick in range(150):
        clock.wait_until(begun + 0.01 * tick)
    assert clock.now() == pytest.approx(begun + 1.49, abs=0.01)
    assert clock.now() - twin.now() < 0.01


def test_a_patient_caller_who_is_early_finds_the_world_at_the_present(wall: Wall) -> None:
    twin = TwinClock()
    seen: list[float] = []
    twin.every(0.005, seen.append, Turn.WORLD)
    clock = RealTimeClock(twin, patience=0.02)
    clock.wait_until(0.05)
    assert twin.now() == pytest.approx(0.05)
    assert clock.now() == pytest.approx(0.05)
    assert len(seen) == 10


def cost(wall: Wall, seconds: float) -> None:
    wall.seconds += seconds
