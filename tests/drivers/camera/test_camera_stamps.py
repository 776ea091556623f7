"""When a frame was exposed, and which are missing."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.camera.abi import BufferFlag
from drivers.camera.frame import Sequence, Shutter, StampSource

SHUTTER = Shutter(period=1 / 30, exposure=0.01, readout=0.006)
START = BufferFlag.TIMESTAMP_MONOTONIC | BufferFlag.SOURCE_START_OF_EXPOSURE
END = BufferFlag.TIMESTAMP_MONOTONIC


def test_start_and_end_stamps_give_the_same_middle() -> None:
    begun = 100.0
    end = begun + SHUTTER.exposure + SHUTTER.readout
    assert SHUTTER.middle(begun, START, 100.05) == (pytest.approx(100.005), StampSource.START)
    assert SHUTTER.middle(end, END, 100.05) == (pytest.approx(100.005), StampSource.END)


@pytest.mark.parametrize("stamp", [100.04, 97.9, 0.0, 1e9])
def test_stamp_out_of_its_time_gives_way_to_the_dequeue_time(stamp: float) -> None:
    middle, source = SHUTTER.middle(stamp, START, taken=100.0)
    assert source is StampSource.DEQUEUE
    assert middle == pytest.approx(100.0 - 0.006 - 0.005)


@pytest.mark.parametrize("flags", [0, 0x4000, BufferFlag.SOURCE_START_OF_EXPOSURE])
def test_stamp_of_an_unknown_clock_is_not_believed(flags: int) -> None:
    assert SHUTTER.middle(100.0, flags, taken=100.01)[1] is StampSource.DEQUEUE


def test_stamp_a_little_ahead_is_believed() -> None:
    assert SHUTTER.middle(100.02, START, taken=100.0)[1] is StampSource.START


@given(st.integers(0, 2**32 - 1), st.lists(st.integers(1, 1000), min_size=1, max_size=30))
def test_numbers_follow_the_counter_across_its_wrap(first: int, steps: list[int]) -> None:
    sequence = Sequence()
    sequence.step_to(first)
    counter = first
    for step in steps:
        counter = (counter + step) % 2**32
        assert sequence.step_to(counter) == step
    assert sequence.number == sum(steps)


def test_counter_that_repeats_or_goes_back_still_numbers_on() -> None:
    sequence = Sequence()
    steps = [sequence.step_to(counter) for counter in (7, 7, 5, 6, 9)]
    assert steps == [1, 0, -2, 1, 3]
    assert sequence.number == 6


def test_restart_counts_what_was_missed() -> None:
    sequence = Sequence()
    sequence.step_to(50)
    sequence.restart(missing=9)
    assert (sequence.step_to(0), sequence.number) == (1, 10)
