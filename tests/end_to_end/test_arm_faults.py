"""Faults of a robot, driven through its own library: named, at rest, recorded.

All faults in all phases: `python -m tests.benchmarks.arm_faults`.
"""

import pytest

pytest.importorskip("pylibfranka", reason="the robot's library is not installed")

from tests.support.arm_faults import STRIKES, struck

QUICK = ("reflex", "TCP drop", "wrong version", "NaN", "contact 20 N", "silent parent")
PROCESSES = ("killed child", "killed parent")


@pytest.mark.parametrize("fault", [*QUICK, *PROCESSES])
def test_fault_is_named_the_arm_rests_and_the_record_is_whole(fault, tmp_path) -> None:
    came = struck(fault, "PREFLIGHT", tmp_path)
    assert came.outcome in STRIKES[fault][1]
    assert came.rests
    assert came.whole


@pytest.mark.slow
@pytest.mark.parametrize("fault", ["reflex", "frozen 0.7 s", "silent parent", "killed child"])
def test_fault_in_the_middle_of_the_fold_likewise(fault, tmp_path) -> None:
    came = struck(fault, "FOLD", tmp_path)
    assert came.outcome in STRIKES[fault][1]
    assert came.rests
    assert came.whole
