"""Faults of a robot, driven through its own library: named, at rest, recorded."""

import pytest

pytest.importorskip("pylibfranka", reason="the robot's library is not installed")

from tests.support.arm_faults import PHASES, STRIKES, struck

QUICK = ("reflex", "TCP drop", "wrong version", "NaN", "contact 20 N", "silent parent")
PROCESSES = ("killed child", "killed parent")


@pytest.mark.slow
@pytest.mark.parametrize("fault", [*QUICK, *PROCESSES])
def test_fault_is_named_the_arm_rests_and_the_record_is_whole(fault, tmp_path) -> None:
    came = struck(fault, "PREFLIGHT", tmp_path)
    assert came.outcome in STRIKES[fault][1]
    assert came.rests
    assert came.whole


@pytest.mark.long
@pytest.mark.parametrize("phase", PHASES)
@pytest.mark.parametrize("fault", STRIKES)
def test_every_fault_in_every_phase_likewise(fault, phase, tmp_path) -> None:
    came = struck(fault, phase, tmp_path)
    assert came.outcome in STRIKES[fault][1]
    assert came.rests
    assert came.whole
