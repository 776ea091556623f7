"""Runs that start hanging: what came before t = 0 stays in the streams, and out of the tables."""

from pathlib import Path

import numpy as np
import pytest

from cell.orchestrator.recorder import Recorder
from cell.orchestrator.snapshot import Snapshot
from cell.orchestrator.states import State
from cell.orchestrator.vision import View
from cell.perception.measurement import StripMeasurement
from cell.record.run import Run, read_run
from cell.record.stream import TICK_ROWS, read_stream
from cell.record.writer import RunWriter
from drivers.types import ZERO_VELOCITY, ArmState, Frame, HandState, Pose
from tests.cell.conftest import HEADER, RESULT

LIFT, HANGS, END = 4.0, 6.5, 9.0  # s of the cell's clock
HAND = HandState(0.0, 0.0, "made", 0.001, True, False)


def snapshot(clock: float) -> Snapshot:
    """A tick at `clock` [s]: up until it hangs, then inwards."""
    x, z = 0.6 - 0.02 * (clock - LIFT), min(0.04 * (clock - LIFT), 0.1)
    pose = Pose(x, z, min(1.0 * (clock - LIFT), np.pi / 2))
    arm = ArmState(clock, clock, "made", pose, ZERO_VELOCITY, pose, True, False)
    state = State.LIFT if clock < HANGS else State.FOLD
    return Snapshot(clock, state, LIFT, arm, HAND, View())


def sight(clock: float, sequence: int) -> StripMeasurement:
    pose = snapshot(clock).arm.pose
    curve = np.linspace((0.4, 0.0), (pose.x, pose.z), 9)
    nothing = float("nan")
    return StripMeasurement(
        clock, sequence, 0.4, 1.0, curve, 1.0, (pose.x, pose.z), nothing, nothing
    )


def picture(clock: float, sequence: int) -> Frame:
    return Frame(
        clock, clock + 0.02, "made", sequence, np.full((4, 6, 3), sequence % 256, np.uint8)
    )


def recorded(root: Path, until: float = END, *, start: str = "hanging") -> Path:
    """The folder of a run that ends at `until` [s]."""
    writer = RunWriter.create(root, HEADER | {"start": start}, "all", patient=True)
    record = Recorder(writer, hanging=start == "hanging")
    record.frame(picture(1.0, 0))
    for k in range(round((until - LIFT) / 0.01) + 1):
        clock = round(LIFT + 0.01 * k, 2)
        if clock in (LIFT, HANGS):
            record.begin(clock)
        record.tick(snapshot(clock), 0.001)
        if k % 10 == 0:
            record.sight(sight(clock, k + 1))
            record.frame(picture(clock, k + 1))
    whole = until >= END
    record.finish(RESULT | {"t_layer_touch": 2.0} if whole else {"outcome": "grip_lost"})
    return writer.folder


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return read_run(recorded(tmp_path_factory.mktemp("hanging")))


def test_the_tables_begin_where_the_strip_hangs(run: Run) -> None:
    assert run.header.start == "hanging"
    assert run.ticks.t[0] == pytest.approx(0.0, abs=1e-9)
    assert run.ticks.t[-1] == pytest.approx(END - HANGS)
    assert run.ticks.z[0] == pytest.approx(0.1)
    assert run.ticks.pitch[0] == pytest.approx(np.pi / 2)
    assert len(run.ticks.t) == round((END - HANGS) / 0.01) + 1


def test_a_run_that_ends_in_its_lift_has_no_rows_but_all_that_was_seen(tmp_path: Path) -> None:
    run = read_run(recorded(tmp_path, until=5.0))
    assert run.result is not None
    assert run.ticks.t.size == run.profile.t.size == run.sights().stamp.size == 0
    assert read_stream(run.folder / "ticks.arrows", TICK_ROWS).num_rows == 101
    assert len(run.frame_index()) == 12


def test_a_flat_run_is_recorded_from_its_lift_on(tmp_path: Path) -> None:
    writer = RunWriter.create(tmp_path, HEADER, "none")
    record = Recorder(writer)
    record.begin(LIFT)
    record.tick(snapshot(LIFT), 0.0)
    record.tick(snapshot(LIFT + 0.01), 0.0)
    record.finish({"outcome": "path_done"})
    run = read_run(writer.folder)
    assert run.ticks.t.tolist() == pytest.approx([0.0, 0.01])
    assert [event.kind for event in run.events()] == ["origin"]
