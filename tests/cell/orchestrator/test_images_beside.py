"""With images read beside the loop it keeps its rate, and a reader that fails stops the
arm.
"""

import math
from dataclasses import replace
from itertools import cycle
from types import SimpleNamespace

import pytest

import cell.orchestrator.run as orchestrator
from cell.orchestrator.run import time_limit
from cell.orchestrator.safe_stop import run_suppressed
from cell.orchestrator.snapshot import Drive, Snapshot
from cell.orchestrator.states import State
from cell.perception.image_reader import ImageResult, ImageTask
from drivers.base.errors import Fault
from drivers.base.types import Pose
from tests.support.plain_cell import (
    AWAY,
    Bench,
    driven,
    driving,
    phases,
    plain_bench,
    result_of,
)


class LateReader:
    """Answers `ticks` looks after it was given an image."""

    latency = 0.0
    shifts = cycle([math.nan])  # m

    def __init__(self, ticks: int) -> None:
        self.ticks, self.left, self.begun = ticks, 0, []
        self.asked: list[ImageTask] = []
        self.busy_since: float | None = None
        self.failure = ""

    def submit(self, request: ImageTask, now: float) -> None:
        assert self.busy_since is None
        self.busy_since, self.left = now, self.ticks
        self.begun.append(request.frame)
        self.asked.append(request)

    def result(self) -> ImageResult | None:
        if self.busy_since is None:
            return None
        self.left -= 1
        if self.left >= 0:
            return None
        self.busy_since = None
        seen = result_of(self.begun[-1], Pose(0.0, 0.0, 0.0), touches=False)
        return replace(seen, shift=next(self.shifts))


def folding(bench: Bench, reader: LateReader, fold=None) -> list[Snapshot]:
    bench.reader, bench.phases, seen = reader, phases(FOLD=fold or driven(100)), []
    bench.observers = (
        SimpleNamespace(handle_tick=seen.append, handle_event=lambda *_: None),
    )
    return seen


@pytest.fixture
def bench() -> Bench:
    return plain_bench()


@pytest.mark.parametrize("ticks", [0, 1, 4])
def test_the_newest_image_is_read_as_soon_as_the_last_is_done(bench, ticks) -> None:
    reader = LateReader(ticks)
    seen = folding(bench, reader)
    assert bench.run().name == "path_done"
    moments = [s for s in seen if s.state is State.FOLD]
    ages = [s.time - s.view.measurement.stamp for s in moments if s.view.read]
    assert len(ages) >= 90 // max(ticks, 1)
    assert max(ages) <= 0.01 * ticks + 1e-9
    assert len(moments) >= 99


def test_an_image_is_measured_at_the_moment_that_it_shows(bench) -> None:
    reader = LateReader(1)
    reader.latency = 0.05  # s by which images show an earlier world than their stamp
    seen = folding(bench, reader)
    assert bench.run().name == "path_done"
    arm = {round(snapshot.time, 6): snapshot.arm.pose for snapshot in seen}
    late = [task for task in reader.asked if task.frame.stamp > 0.2]
    taken = {s.view.frame.sequence: s.view.frame.stamp for s in seen if s.view.frame}
    assert len(late) > 30
    for task in late:
        shown = taken[task.frame.sequence] - task.frame.stamp
        assert shown == pytest.approx(reader.latency)
        assert task.gripper.x == pytest.approx(arm[round(task.frame.stamp, 6)].x)


def test_a_reader_that_hangs_stops_the_arm_one_tick_after_its_time(bench) -> None:
    reader = LateReader(10**9)
    folding(bench, reader)
    outcome = bench.run()
    assert outcome.name == "image_reading_overdue"
    assert outcome.exit_code == 4
    assert bench.at_rest
    assert "260 ms, allowed 250 ms" in outcome.reason


def test_a_reader_that_dies_stops_the_arm_at_the_next_tick(bench) -> None:
    reader = LateReader(1)

    def dying(*_):
        yield from driven(30)()
        reader.failure = "the process for images has ended"
        yield from driving()

    folding(bench, reader, dying)
    outcome = bench.run()
    assert (outcome.name, outcome.reason) == ("image_reader_dead", reader.failure)
    assert bench.at_rest
    assert sum(isinstance(c, Drive) for c in bench.arm.commands) == 31


@pytest.mark.parametrize(
    ("shifts", "ends"), [([0.01], "camera_moved"), ([0.01, 0.0], "path_done")]
)
def test_the_scene_has_moved_where_images_in_a_row_show_it(bench, shifts, ends) -> None:
    reader = LateReader(0)
    reader.shifts = cycle(shifts)
    folding(bench, reader)
    assert bench.run().name == ends


def test_a_turn_that_hangs_is_ended_and_stops_the_arm(bench, monkeypatch) -> None:
    def hanging(*_):
        yield Drive(AWAY)
        while True:
            pass

    folding(bench, LateReader(0), hanging)
    monkeypatch.setattr(orchestrator, "time_limit", lambda _: time_limit(0.1))
    assert bench.run().name == "turn_overtime"
    assert bench.at_rest


def test_a_turn_in_time_leaves_no_alarm_behind() -> None:
    with time_limit(0.02):
        pass
    with (
        pytest.raises(Fault, match="longer than 0.02 s".replace(".", r"\.")),
        time_limit(0.02),
    ):
        forever()


def test_a_turn_that_took_too_long_stops_the_arm_though_the_alarm_was_suppressed():
    with pytest.raises(Fault, match="takes longer than"), time_limit(0.02):
        assert not run_suppressed(forever)


def forever() -> None:
    while True:
        pass
