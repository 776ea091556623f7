"""Checks of the stream of frames: gaps, corrupt ones, numbers, stamps."""

from itertools import pairwise

import numpy as np

from drivers.v4l2.session import StampSource
from tests.drivers.v4l2.vivid.device import END, START, Vivid, frames


def check_gaps_are_counted_under_40_percent_drops(vivid: Vivid) -> None:
    with (
        vivid.having(percentage_of_dropped_buffers=40, timestamp_source=START),
        vivid.camera() as camera,
    ):
        seen = frames(camera, 36)
        counts = camera.counts
        share = counts.missing / (counts.missing + counts.arrived)
    assert 0.2 < share < 0.6, (
        f"{share:.2f} of the frames are counted as missing: {counts}"
    )
    for a, b in pairwise(seen):
        lost = round((b.stamp - a.stamp) * camera.rate) - 1
        assert abs(lost - (b.sequence - a.sequence - 1)) <= 1, (
            f"{a.sequence}, {b.sequence}: {lost}"
        )


def check_corrupt_frame_is_counted_and_never_delivered(vivid: Vivid) -> None:
    with vivid.camera() as camera:
        seen = frames(camera, 3)
        for _ in range(3):
            vivid.set(inject_v4l2_buf_flag_error=1)
            seen += frames(camera, 3)
        counts = camera.counts
    numbers = {frame.sequence for frame in seen}
    assert max(numbers) - min(numbers) + 1 - len(numbers) >= counts.corrupt >= 2, counts


def check_wrapped_sequence_counts_no_gap(vivid: Vivid) -> None:
    with (
        vivid.having(wrap_sequence_number=1),
        vivid.camera(width=320, height=180, rate=60) as camera,
    ):
        seen = frames(camera, 150)
        counts = camera.counts
    assert all(b.sequence > a.sequence for a, b in pairwise(seen))
    assert seen[-1].sequence < 2000, seen[-1].sequence
    assert counts.missing < 2000, counts


def check_wrapped_time_is_replaced_by_the_dequeue_time(vivid: Vivid) -> None:
    with vivid.having(wrap_timestamp=1), vivid.camera() as camera:
        seen = frames(camera, 20)
        assert camera.counts.restamped >= 15, camera.counts
    assert {frame.stamp_source for frame in seen[1:]} == {StampSource.DEQUEUE}
    assert all(0 < frame.arrival - frame.stamp < 0.5 for frame in seen)


def check_stamps_tell_start_from_end_of_exposure(vivid: Vivid) -> None:
    for number, source, exposure, readout, least in (
        (START, StampSource.START, 0.0, 0.0, 0.0),
        # vivid's stamp lies up to 0.03 s ahead
        (END, StampSource.END, 0.02, 0.06, 0.03),
    ):
        with (
            vivid.having(timestamp_source=number),
            vivid.camera(exposure=exposure, readout=readout) as camera,
        ):
            seen = frames(camera, 15)
        assert {frame.stamp_source for frame in seen} == {source}
        age = float(np.median([frame.arrival - frame.stamp for frame in seen]))
        assert least < age < 1.0, f"{source}: {age:.3f} s"
