"""What every clock must do."""

import pytest

from drivers.base.protocols import Clock


def test_time_begins_at_zero(clock: Clock) -> None:
    assert clock.now() == pytest.approx(0.0, abs=1e-3)


def test_waiting_ends_no_earlier_than_asked(clock: Clock) -> None:
    clock.wait_until(0.25)
    assert clock.now() == pytest.approx(0.25, abs=1e-3)
    clock.wait_until(clock.now() + 0.01)
    assert clock.now() == pytest.approx(0.26, abs=1e-3)


def test_waiting_for_the_past_returns_at_once_and_time_stays(clock: Clock) -> None:
    clock.wait_until(0.5)
    before = clock.now()
    clock.wait_until(0.1)
    clock.wait_until(-3.0)
    assert clock.now() == pytest.approx(before, abs=1e-3)
    assert clock.now() >= before
