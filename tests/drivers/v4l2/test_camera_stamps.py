"""When a frame was exposed."""

import pytest

from drivers.v4l2.abi import BufferFlag
from drivers.v4l2.session import Shutter, StampSource

SHUTTER = Shutter(period=1 / 30, exposure=0.01, readout=0.006)
START = BufferFlag.TIMESTAMP_MONOTONIC | BufferFlag.SOURCE_START_OF_EXPOSURE
END = BufferFlag.TIMESTAMP_MONOTONIC


def test_start_and_end_stamps_give_the_same_middle() -> None:
    begun = 100.0
    end = begun + SHUTTER.exposure + SHUTTER.readout
    assert SHUTTER.middle(begun, START, 100.05) == (
        pytest.approx(100.005),
        StampSource.START,
    )
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
