"""How the process of the loop is scheduled."""

import os
import subprocess
import sys

import pytest

from drivers.arm.failure import Cause, Failed
from drivers.arm.scheduling import PRIORITY, schedule

PROMPT = """
import os
from drivers.arm.scheduling import schedule
schedule("ignore")
assert os.sched_getscheduler(0) == os.SCHED_OTHER
"""


def test_prompt_wake_up_leaves_the_ordinary_scheduler() -> None:
    subprocess.run([sys.executable, "-c", PROMPT], check=True)


def test_real_time_priority_is_asked_for_this_process_and_not_its_children(monkeypatch) -> None:
    asked = []
    monkeypatch.setattr(os, "sched_setscheduler", lambda *given: asked.append(given))
    schedule("enforce")  # the library has done it
    assert not asked
    schedule("priority")
    ((_, policy, priority),) = asked
    assert policy == os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
    assert priority.sched_priority == PRIORITY


def test_priority_that_is_not_allowed_is_refused_by_name(monkeypatch) -> None:
    def forbidden(*_: object) -> None:
        raise PermissionError

    monkeypatch.setattr(os, "sched_setscheduler", forbidden)
    with pytest.raises(Failed, match="real-time priority") as failed:
        schedule("priority")
    assert failed.value.failure.cause is Cause.REALTIME
