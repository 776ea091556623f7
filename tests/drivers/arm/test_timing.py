"""How evenly the robot's states came."""

import pytest

from drivers.arm.joint_log import EDGES_MS, Timing


def test_intervals_are_counted_in_their_bins_and_the_longest_is_kept() -> None:
    timing = Timing()
    for now, success in ((0.0, 1.0), (0.001, 1.0), (0.002, 0.5), (0.2, 0.5)):
        timing.update(now, success)
    told = timing.content()
    assert sum(told["counts"]) == 3
    assert told["counts"][-1] == 1
    assert told["counts"][EDGES_MS.index(1.1)] == 2
    assert told["longest_ms"] == pytest.approx(198.0)
    assert told["answered"] == pytest.approx(0.75)
