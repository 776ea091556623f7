"""Collections of garbage in a run look at what the run itself has left, and at nothing
else.
"""

import gc
import os
import sys

import pytest

from cell.folding.fold import realtime_thread


def test_a_whole_collection_looks_at_no_object_from_before() -> None:
    before = [[] for _ in range(50_000)]
    with realtime_thread(True):
        assert gc.get_freeze_count() > len(before)
        assert len(gc.get_objects()) < 5_000
    assert gc.get_freeze_count() == 0


@pytest.mark.parametrize("real_time", [False, True])
def test_the_loop_goes_first_on_the_wall_clock_alone_and_not_afterwards(
    real_time,
) -> None:
    before, frozen = (
        (sys.getswitchinterval(), os.sched_getscheduler(0)),
        gc.get_freeze_count(),
    )
    with realtime_thread(real_time):
        assert (gc.get_freeze_count() > frozen) is real_time
        assert (sys.getswitchinterval() < before[0]) is real_time
    assert (sys.getswitchinterval(), os.sched_getscheduler(0)) == before
