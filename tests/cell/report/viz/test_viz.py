import shutil
import threading
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from rerun.chunk import RrdReader

from calibration.calibration import save_calibration
from cell.orchestrator.snapshot import Snapshot
from cell.orchestrator.states import State
from cell.orchestrator.vision import View
from cell.perception.strip_measurement import StripMeasurement
from cell.record.run import read_run
from cell.record.writer import RunWriter
from cell.report.viz import recording
from cell.report.viz.recording import Screen, Shadow, viz_from_run
from cell.report.viz.watch import WAITING, LiveView
from drivers.base.types import ZERO_VELOCITY, ArmState, Frame, HandState, Pose
from drivers.strip.file import StripFile
from tests.cell.conftest import HEADER

STRIP = StripFile.model_validate(HEADER["strip_file"])


def entities(path: Path) -> dict[str, int]:
    """Rows of each entity in a recording."""
    rows: dict[str, int] = {}
    for chunk in RrdReader(path).stream().to_chunks():
        rows[chunk.entity_path] = rows.get(chunk.entity_path, 0) + chunk.num_rows
    return rows


def timelines(path: Path, entity: str) -> set[str]:
    chunks = RrdReader(path).stream().to_chunks()
    named = [
        set(c.timeline_names)
        for c in chunks
        if c.entity_path == entity and not c.is_static
    ]
    return set.union(*named)


def snapshot(k: int, state: State = State.FOLD, every: int = 2) -> Snapshot:
    """Tick number k of a fold whose camera delivers an image every other tick."""
    time = 0.01 * k
    pose = Pose(0.6 - 0.05 * time, 0.05 * time, 0.5)
    arm = ArmState(time, time, "made", pose, ZERO_VELOCITY, pose, True, False)
    hand = HandState(time, time, "made", 0.0, True, False)
    sequence = k // every
    frame = Frame(
        time, time, "made", sequence, np.full((72, 128, 3), k % 255, np.uint8)
    )
    curve = np.linspace((0.4, 0.0), (pose.x, pose.z), 20)
    measurement = StripMeasurement(
        time, sequence, 0.4, 1.0, curve, 1.0, (pose.x, pose.z), np.nan, np.nan
    )
    view = View(frame, k % every == 0, 1, measurement)
    return Snapshot(time, state, 0.0, arm, hand, view)


@pytest.fixture(autouse=True)
def unseen(monkeypatch) -> None:
    """A viewer that nobody opens."""
    monkeypatch.setattr(recording, "open_viewer", lambda _: None)


def watch(viz: LiveView, count: int) -> None:
    viz.handle_event(0.0, "state", {"state": State.LIFT, "event": "grasped"})
    for k in range(count):
        viz.handle_tick(snapshot(k, State.LIFT if k < 50 else State.FOLD))


@pytest.fixture(scope="module")
def rebuilt(finished, tmp_path_factory):
    folder = shutil.copytree(finished, tmp_path_factory.mktemp("viz") / finished.name)
    return viz_from_run(folder)


def test_stored_run_is_shown_again(rebuilt):
    rows = entities(rebuilt)
    kept = sum(note.file is not None for note in read_run(rebuilt.parent).frame_index())
    assert rows["/camera/image"] == kept
    assert rows["/camera/overlay/profile"] == rows["/strip/measured"] == 94
    assert rows["/strip/twin"] == 235
    assert rows["/log"] == 3
    assert rows["/signals/along/gripper_x"] == 940 + 1
    assert {"/gripper", "/gripper/path", "/cell/state", "/signals/above/gap"} <= set(
        rows
    )
    assert timelines(rebuilt, "/gripper") >= {"t", "tick"}
    assert timelines(rebuilt, "/signals/above/gripper_z") == {"t", "tick"}


def test_dead_run_is_shown_as_far_as_it_goes(killed, tmp_path):
    folder = shutil.copytree(killed, tmp_path / killed.name)
    rows = entities(viz_from_run(folder))
    assert rows["/strip/measured"] == 43
    assert rows["/signals/along/gripper_x"] == 429 + 1


def test_watched_fold_is_recorded(tmp_path):
    viz = LiveView(tmp_path, STRIP)
    watch(viz, 200)
    viz.handle_event(1.99, "fault", {"name": "stale_image", "reason": "too old"})
    viz.close(60)
    rows = entities(tmp_path / "run.rrd")
    assert viz.failure == ""
    assert rows["/strip/measured"] == 100
    assert rows["/cell/state"] == 2 + 1
    assert rows["/log"] == 2
    assert rows["/signals/along/contact_x"] == 100 + 1


def test_overlay_is_drawn_where_the_runs_calibration_puts_it(tmp_path, calibration):
    save_calibration(calibration, tmp_path / "calibration.yaml")
    viz = LiveView(tmp_path, STRIP)
    watch(viz, 40)
    viz.close(60)
    rows = entities(tmp_path / "run.rrd")
    assert rows["/camera/overlay/profile"] == 20
    assert rows["/camera/image"] == 4
    changed = (
        (tmp_path / "calibration.yaml")
        .read_text()
        .replace("camera: made", "camera: other")
    )
    (tmp_path / "calibration.yaml").write_text(changed)
    viz = LiveView(tmp_path, STRIP)
    viz.close(60)
    assert "changed by hand" in viz.failure


def test_thread_that_hangs_drops_the_oldest_and_holds_nothing_up(tmp_path, monkeypatch):
    drawn, gate, stuck = [], threading.Event(), threading.Event()

    def slow(self, item):
        stuck.set()
        gate.wait()
        drawn.append(item)

    monkeypatch.setattr(Screen, "draw", slow)
    viz = LiveView(tmp_path, STRIP)
    viz.handle_tick(snapshot(0))
    assert stuck.wait(60)
    for k in range(1, WAITING + 301):
        viz.handle_tick(snapshot(k))
    viz.close(timeout=0.01)
    gate.set()
    viz.close(60)
    assert [item.tick for item in drawn] == [1, *range(302, WAITING + 302)]
    assert sum(item.image is not None for item in drawn) <= 17


def test_machine_without_a_viewer_still_writes_the_file(tmp_path, monkeypatch):
    monkeypatch.setattr(
        recording, "open_viewer", Mock(side_effect=FileNotFoundError("rerun"))
    )
    viz = LiveView(tmp_path, STRIP)
    watch(viz, 20)
    viz.close(60)
    assert viz.failure == ""
    assert entities(tmp_path / "run.rrd")["/signals/along/gripper_x"] == 20 + 1


def test_file_that_cannot_be_written_ends_the_view_and_not_the_fold(tmp_path):
    viz = LiveView(tmp_path / "nowhere", STRIP)
    viz.close(60)
    watch(viz, 20)
    assert "not recorded any more" in viz.failure


@pytest.mark.parametrize("jump", [1e9, 10.0])
def test_shadow_ends_where_a_stamp_jumps_by_years_or_is_in_milliseconds(jump: float):
    shadow, pose = Shadow(STRIP), np.array([STRIP.length, 0.0, 0.0])
    assert shadow.follow(1.0, pose).size
    assert not shadow.follow(1.0 + jump, pose).size
    assert not shadow.follow(1.02 + jump, pose).size


def test_film_of_a_run_is_in_its_recording_at_the_cameras_own_times(tmp_path):
    writer = RunWriter(tmp_path, HEADER, "none", patient=True, film="libx264")
    writer.event(5.0, "origin")
    stamps = [0.06 * k + 0.01 * (k % 3) - 0.2 for k in range(20)]
    for k, stamp in enumerate(stamps):
        image = np.full((64, 96, 3), 9 * k, np.uint8)
        writer.frame(Frame(stamp, stamp + 0.02, "made", k, image))
    writer.finish({"outcome": "path_done"})
    chunks = RrdReader(viz_from_run(writer.folder)).stream().to_chunks()
    (found,) = (
        c for c in chunks if c.entity_path == "/camera/film" and not c.is_static
    )
    table = found.to_record_batch()
    for name, offset in (("t", 0.0), ("clock", 5.0)):
        times = table.column(name).cast("int64").to_numpy() / 1e9
        assert times == pytest.approx([stamp + offset for stamp in stamps], abs=1e-8)
    assert any(c.entity_path == "/camera/film" and c.is_static for c in chunks)
