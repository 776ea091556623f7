"""The process that owns a robot: its scheduling, values that it shares, how evenly
states came.
"""

import os
import subprocess
import sys
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest

from drivers.base.child import Child
from drivers.franka.failure import ArmFault, Cause
from drivers.franka.joint_log import (
    EDGES_MS,
    JOINT_FIELDS,
    JointLog,
    Timing,
    joint_rows,
)
from drivers.franka.mailbox import Mailbox
from drivers.franka.process import PRIORITY, apply_realtime

PROMPT = """
import os
from drivers.franka.process import apply_realtime
apply_realtime("ignore")
print(os.sched_getscheduler(0))
"""


def test_prompt_wake_up_leaves_the_ordinary_scheduler() -> None:
    done = subprocess.run(
        [sys.executable, "-c", PROMPT], check=True, capture_output=True
    )
    assert int(done.stdout) == os.SCHED_OTHER


def test_real_time_priority_is_asked_for_this_process_and_not_its_children(
    monkeypatch,
) -> None:
    asked = []
    monkeypatch.setattr(os, "sched_setscheduler", lambda *given: asked.append(given))
    apply_realtime("enforce")  # the library has done it
    assert not asked
    apply_realtime("priority")
    ((_, policy, priority),) = asked
    assert policy == os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
    assert priority.sched_priority == PRIORITY


def test_priority_that_is_not_allowed_is_refused_by_name(monkeypatch) -> None:
    def forbidden(*_: object) -> None:
        raise PermissionError

    monkeypatch.setattr(os, "sched_setscheduler", forbidden)
    with pytest.raises(ArmFault, match="real-time priority") as failed:
        apply_realtime("priority")
    assert failed.value.cause is Cause.REALTIME


Eight = NamedTuple("Eight", [(name, int) for name in "abcdefgh"])


def write_for_ever(pipe, values: Mailbox) -> None:
    pipe.send("begun")
    number = 0
    while True:
        number += 1
        values.write(Eight(*[number] * 8))


def test_no_value_is_ever_torn() -> None:
    values, last = Mailbox(Eight), 0
    process = Child(write_for_ever, values)
    assert process.receive(20.0) == "begun"
    try:
        for _ in range(20_000):
            seen = values.read()
            assert len(set(seen)) == 1
            assert seen.a >= last
            last = seen.a
    finally:
        process.kill()
    assert values.read().a >= last  # a writer that was killed holds nobody up


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


def test_a_log_holds_measured_and_commanded_joints_apart() -> None:
    log = JointLog()
    log.add(0.5, SimpleNamespace(**{n: [k] * 7 for k, n in enumerate(JOINT_FIELDS)}))
    (row,) = joint_rows(log.content())
    assert row.tolist() == [0.5, *np.repeat(range(len(JOINT_FIELDS)), 7)]
