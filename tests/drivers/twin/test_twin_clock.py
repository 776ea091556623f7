"""The twin's clock: order, exactness, errors."""

import pytest

from drivers.errors import CellError, Fault
from drivers.twin.clock import Turn, TwinClock


def test_periodic_events_do_not_drift() -> None:
    clock, times = TwinClock(), []
    clock.every(1 / 60, times.append, Turn.CAMERA)
    clock.wait_until(100.0)
    assert len(times) == 6000
    assert times[-1] == 100.0
    assert max(abs(t - (n + 1) / 60) for n, t in enumerate(times)) < 1e-9


def test_ticks_steps_and_frames_of_one_moment_run_in_their_turn() -> None:
    clock, seen = TwinClock(), []
    clock.every(0.035, lambda t: seen.append(("camera", t)), Turn.CAMERA)
    clock.every(0.005, lambda t: seen.append(("world", t)), Turn.WORLD)
    clock.every(0.001, lambda t: seen.append(("servo", t)), Turn.SERVO)
    clock.wait_until(0.1)
    by_time: dict[float, list[str]] = {}
    for name, time in seen:
        by_time.setdefault(time, []).append(name)
    assert len(by_time) == 100
    assert by_time[0.035] == by_time[0.07] == ["servo", "world", "camera"]
    assert by_time[0.04] == ["servo", "world"]
    assert by_time[0.041] == ["servo"]


def test_events_of_one_turn_run_in_the_order_of_asking() -> None:
    clock, seen = TwinClock(), []
    for name in "abc":
        clock.at(0.5, lambda _, name=name: seen.append(name), Turn.JOB)
    clock.wait_until(1.0)
    assert seen == ["a", "b", "c"]


def test_event_sees_its_own_time_and_the_clock_ends_where_asked() -> None:
    clock, seen = TwinClock(), []
    clock.at(0.3, lambda t: seen.append((t, clock.now())), Turn.JOB)
    clock.wait_until(0.2999)
    assert seen == []
    clock.wait_until(1.0)
    assert seen == [(0.3, 0.3)]
    assert clock.now() == 1.0


def test_event_can_ask_for_later_events_and_cancel_itself() -> None:
    clock, seen = TwinClock(), []

    def once(now: float) -> None:
        seen.append(now)
        clock.at(now + 0.1, seen.append, Turn.JOB)
        event.cancel()

    event = clock.every(0.25, once, Turn.JOB)
    clock.wait_until(2.0)
    assert seen == [0.25, 0.35]


def test_event_asked_for_in_the_past_runs_as_soon_as_time_passes() -> None:
    clock, seen = TwinClock(), []
    clock.wait_until(1.0)
    clock.at(0.5, seen.append, Turn.JOB)
    assert seen == []
    clock.wait_until(1.0)
    assert seen == [1.0]


def test_periodic_event_starts_from_when_it_was_asked_for() -> None:
    clock, seen = TwinClock(), []
    clock.wait_until(1.003)
    clock.every(0.1, seen.append, Turn.WORLD)
    clock.every(0.5, seen.append, Turn.CAMERA, start=1.0)
    clock.wait_until(1.5)
    assert seen == [1.103, 1.203, 1.303, 1.403, 1.5]


def test_error_of_an_event_comes_out_at_its_time_and_the_clock_goes_on_after_it() -> None:
    clock, seen = TwinClock(), []

    def fail(now: float) -> None:
        raise Fault("strip_torn", f"at {now}")

    clock.at(0.5, fail, Turn.WORLD)
    clock.every(0.2, seen.append, Turn.SERVO)
    with pytest.raises(Fault, match=r"at 0\.5"):
        clock.wait_until(1.0)
    assert clock.now() == 0.5
    clock.wait_until(1.0)
    assert seen == [0.2, 0.4, 0.6, 0.8, 1.0]


def test_event_cannot_wait() -> None:
    clock = TwinClock()
    clock.at(0.1, lambda _: clock.wait_until(0.5), Turn.JOB)
    with pytest.raises(CellError, match="cannot wait"):
        clock.wait_until(1.0)


def test_period_of_nothing_is_refused() -> None:
    with pytest.raises(CellError, match="too short"):
        TwinClock().every(0.0, lambda _: None, Turn.JOB)
