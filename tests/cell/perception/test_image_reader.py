"""A process beside the loop measures images: what it sees comes back whole, and its end
is seen.
"""

import os
import signal
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict
from types import SimpleNamespace

import numpy as np
import pytest

from cell.base.config.settings import MonitorLimits
from cell.base.devices.devices import ArmHistory
from cell.orchestrator.states import State
from cell.orchestrator.vision import View, Vision
from cell.perception.image_reader import ImageTask, ProcessReader, StripInputs
from drivers.base.errors import Fault
from drivers.base.types import ZERO_VELOCITY, ArmState, Frame, Pose
from tests.support.requests import DENIM
from tests.support.sights import FAILS, HANGS, PlainSight

POSE = Pose(0.5, 0.2, 1.5)
PATIENCE = 30.0  # s


def started() -> ProcessReader:
    calibration = SimpleNamespace(lens=SimpleNamespace(height=4, width=6), latency=0.1)
    subject = StripInputs(calibration, DENIM)
    return ProcessReader(subject, PlainSight)


@pytest.fixture(scope="module")
def process() -> Iterator[ProcessReader]:
    process = started()
    yield process
    process.close()


def image(value: int, sequence: int = 7) -> Frame:
    return Frame(1.5, 1.52, "made", sequence, np.full((4, 6, 3), value, np.uint8))


def hand_over(process: ProcessReader, value: int, *, touches: bool = False) -> None:
    process.submit(ImageTask(image(value), POSE, touches), 3.0)


def awaited(look: Callable):
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        if (found := look()) is not None:
            return found
        time.sleep(0.001)
    raise AssertionError("nothing came")


@pytest.mark.parametrize("touches", [False, True])
def test_what_the_process_sees_is_what_the_loop_gets(process, touches) -> None:
    hand_over(process, 40, touches=touches)
    assert process.busy_since == 3.0
    found = awaited(process.result)
    here = PlainSight(None).measure(image(40), POSE, touches=touches)
    assert process.busy_since is None
    assert found.touch == here.touch
    np.testing.assert_equal(asdict(found.measurement), asdict(here.measurement))


def test_an_answer_is_given_once_and_not_before_it_is_asked_for(process) -> None:
    assert process.result() is None
    hand_over(process, 0)
    assert len(awaited(process.result).measurement.profile) == 0
    assert process.result() is None


def test_checks_before_the_grasp_come_back_by_name(process) -> None:
    process.submit(ImageTask(image(3)), 3.0)
    assert [(c.name, c.passed) for c in awaited(process.result)] == [("bright", False)]


def test_an_image_of_another_size_is_refused_before_it_is_handed_over(process) -> None:
    small = Frame(1.5, 1.52, "made", 7, np.zeros((4, 5, 3), np.uint8))
    with pytest.raises(Fault, match="image_size"):
        process.submit(ImageTask(small, POSE, False), 3.0)
    assert process.busy_since is None


def failure_of(process: ProcessReader) -> str:
    awaited(lambda: process.result() or process.failure or None)
    return process.failure


def kill(process: ProcessReader) -> None:
    """Kill the process, whose end must be told."""
    os.kill(process._child.pid, signal.SIGKILL)
    assert "ended" in failure_of(process)
    process.close()


@pytest.mark.slow
def test_a_process_that_hangs_keeps_its_image_and_one_that_is_killed_is_dead() -> None:
    process = started()
    hand_over(process, HANGS)
    assert process.result() is None
    assert (process.busy_since, process.failure) == (3.0, "")
    kill(process)


def test_a_killed_process_is_dead_before_its_pipe_is_closed() -> None:
    process = started()
    pipe = process._child.pipe
    process._child.pipe = SimpleNamespace(poll=lambda _: False, close=pipe.close)
    assert process.result() is None
    assert not process.failure
    kill(process)


class OneFrame:
    """A camera that has one image."""

    rate = 60.0

    def read(self, after: float, timeout: float) -> Frame | None:
        return image(40, 9) if after < 1.5 else None


def test_a_fold_is_judged_and_then_read_by_the_process(process) -> None:
    process.submit(ImageTask(image(40)), 1.6)
    assert awaited(process.result)[0].passed
    history, vision = ArmHistory(), Vision(OneFrame(), MonitorLimits(), process)
    history.add(ArmState(1.5, 1.5, "made", POSE, ZERO_VELOCITY, POSE, False, False))
    first = vision.update(State.FOLD, 1.6, history)
    assert first.fresh
    assert first.read or first.reading_since == 1.6

    def look() -> View | None:
        view = vision.update(State.FOLD, 1.7, history)
        assert not view.fresh
        return view if view.read else None

    view = first if first.read else awaited(look)
    # the latency before the image's
    assert view.measurement.stamp == pytest.approx(1.4)
    assert view.touch is not None
    assert view.reading_since is None


def test_a_process_that_fails_says_why(process) -> None:
    """The last test of this process."""
    hand_over(process, FAILS)
    assert failure_of(process) == "ZeroDivisionError: nobody foresaw this"
