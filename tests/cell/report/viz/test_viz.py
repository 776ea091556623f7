import shutil
import threading
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock, patch

import numpy as np
import pytest
from rerun.chunk import Chunk, RrdReader

from calibration.calibration import save_calibration
from cell.interface.cli.options import said_where
from cell.orchestrator.snapshot import Snapshot
from cell.orchestrator.states import State
from cell.orchestrator.vision import View
from cell.perception.strip_measurement import StripMeasurement
from cell.record.run import read_run
from cell.record.writer import RunWriter
from cell.report.figures import READING
from cell.report.viz import opening
from cell.report.viz.recording import (
    STALE,
    RerunWriter,
    Shadow,
    _camera_view,
    viz_from_run,
)
from cell.report.viz.watch import WAITING, LiveView
from drivers.base.types import ZERO_VELOCITY, ArmState, Frame, HandState, Pose
from drivers.base.yaml_text import dump_yaml
from drivers.strip.file import StripFile
from tests.cell.conftest import HEADER
from tests.support.plain_cell import ARM
from tests.support.run_edits import edit_column, edit_yaml

STRIP = StripFile.model_validate(HEADER["strip_file"])


def chunks(path: Path) -> list[Chunk]:
    return RrdReader(path).stream().to_chunks()


def entities(path: Path) -> Counter[str]:
    """Rows of each entity in a recording."""
    rows: Counter[str] = Counter()
    for chunk in chunks(path):
        rows[chunk.entity_path] += chunk.num_rows
    return rows


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
    monkeypatch.setattr(opening, "open_viewer", lambda _: None)


def begun(folder: Path) -> Path:
    """Folder of a run that has just begun."""
    (folder / "run.yaml").write_text(dump_yaml({"schema": 1} | HEADER), "utf-8")
    return folder


@contextmanager
def live(folder: Path) -> Iterator[LiveView]:
    """View of a run that begins, until its recording is written."""
    viz = LiveView(begun(folder), STRIP)
    yield viz
    viz.close(60)


def watch(viz: LiveView, count: int) -> None:
    viz.handle_event(0.0, "state", {"state": State.LIFT, "event": "grasped"})
    for k in range(count):
        viz.handle_tick(snapshot(k, State.LIFT if k < 50 else State.FOLD))


@pytest.fixture(scope="module")
def rebuilt(finished, tmp_path_factory):
    folder = shutil.copytree(finished, tmp_path_factory.mktemp("viz") / finished.name)
    for file, name in (("sights", "stamp"), ("profile", "t")):  # by another clock
        edit_column(folder / f"{file}.parquet", name, lambda at: at + 8e-3)
    return viz_from_run(folder)


def times(path: Path, entity: str, kind: str = "") -> list[float]:
    """Times [s] on `t` of the rows of an entity, of those whose columns name `kind`."""
    found: list[float] = []
    for chunk in chunks(path):
        batch = chunk.to_record_batch()
        named = any(kind in name for name in batch.schema.names)
        if chunk.entity_path == entity and not chunk.is_static and named:
            found += (1e-9 * batch.column("t").cast("int64").to_numpy()).tolist()
    return sorted(found)


def test_stored_run_is_shown_again(rebuilt):
    rows = entities(rebuilt)
    assert rows["/world/strip/measured"] == 94 + 1
    assert rows["/world/strip/measured/edge"] == 94 + 1
    assert rows["/world/strip/simulated"] == 190 + 2
    assert rows["/log"] == 3
    assert rows["/signals/along/gripper_x"] == 940 + 1
    assert {"/world/desk/0", "/world/path", "/state"} <= set(rows)
    assert {"/world/arm/link8/palm", "/world/camera", "/verdict"} <= set(rows)
    for chunk in chunks(rebuilt):
        if chunk.entity_path == "/world/strip/measured" and not chunk.is_static:
            assert set(chunk.timeline_names) == {"t", "clock"}


@pytest.mark.parametrize(
    "entity",
    [
        "/state",
        "/log",
        "/world/camera/image/picture",
        "/world/camera/image/overlay/profile",
        "/world/strip/measured",
        "/world/strip/simulated",
        "/world/arm/link8",
    ],
)
def test_recording_opens_with_everything_in_place_and_nothing_before(rebuilt, entity):
    assert times(rebuilt, entity)[0] == 0.0


def test_over_each_picture_that_was_read_stands_what_was_read(rebuilt):
    pictures = times(rebuilt, "/world/camera/image/picture")
    read = times(rebuilt, "/world/camera/image/overlay/profile", "strips")
    assert read == [t for t in pictures if read[0] <= t <= read[-1]]


def test_simulated_strip_is_cleared_once_the_layers_touched(rebuilt):
    ticks = read_run(rebuilt.parent).ticks
    last = max(
        t for t, state in zip(ticks.t, ticks.state, strict=True) if state in READING
    )
    (cleared,) = times(rebuilt, "/world/strip/simulated", "Clear")
    assert cleared == pytest.approx(last, abs=0.05)


def test_measured_strip_is_cleared_once_its_measurement_is_old(tmp_path):
    with live(tmp_path) as viz:
        watch(viz, 100)
        for k in range(100, 200):
            seen = snapshot(k)
            viz.handle_tick(replace(seen, view=replace(seen.view, measurement=None)))
    (cleared,) = times(tmp_path / "run.rrd", "/world/strip/measured", "Clear")
    assert cleared == pytest.approx(0.99 + STALE, abs=0.03)


def test_dead_run_is_shown_as_far_as_it_goes(killed, tmp_path):
    folder = shutil.copytree(killed, tmp_path / killed.name)
    rows = entities(viz_from_run(folder))
    assert rows["/world/strip/measured"] == 43 + 1
    assert rows["/signals/along/gripper_x"] == 429 + 1


def test_watched_fold_is_recorded(tmp_path):
    with live(tmp_path) as viz:
        watch(viz, 200)
        viz.handle_event(1.99, "fault", {"name": "stale_image", "reason": "too old"})
    rows = entities(tmp_path / "run.rrd")
    assert viz.failure == ""
    assert rows["/world/strip/measured"] == 100 + 1
    assert rows["/state"] == 2 + 1
    assert rows["/log"] == 2
    assert rows["/signals/along/contact_x"] == 100 + 1


def test_overlay_is_drawn_where_the_runs_calibration_puts_it(tmp_path, calibration):
    save_calibration(calibration, tmp_path / "calibration.yaml")
    with live(tmp_path) as viz:
        watch(viz, 40)
    rows = entities(tmp_path / "run.rrd")
    assert rows["/world/camera/image/overlay/profile"] == 4 + 1
    assert rows["/world/camera/image/picture"] == 4 + 1
    edit_yaml(tmp_path / "calibration.yaml", camera="other")
    with live(tmp_path) as viz:
        pass
    assert "changed by hand" in viz.failure


def test_image_in_the_viewer_stands_upright(calibration) -> None:
    bounds = _camera_view(0.6, calibration).properties["VisualBounds2D"]
    [shown] = bounds.range.as_arrow_array().to_pylist()
    top, bottom = shown["y_range"]
    assert top < bottom


def test_only_this_machine_can_watch_a_fold(tmp_path) -> None:
    sink = opening.rr.GrpcServerSink
    with (
        patch.object(opening.rr, "GrpcServerSink", wraps=sink) as served,
        live(tmp_path),
    ):
        pass
    address, *_ = served.call_args.args
    assert address == "127.0.0.1"


def test_thread_that_hangs_drops_the_oldest_and_holds_nothing_up(tmp_path, monkeypatch):
    drawn, gate, stuck = [], threading.Event(), threading.Event()

    def slow(self, item):
        stuck.set()
        gate.wait()
        drawn.append(item)

    monkeypatch.setattr(RerunWriter, "draw", slow)
    viz = LiveView(begun(tmp_path), STRIP)
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
    monkeypatch.setenv("DISPLAY", ":0")
    missing = Mock(side_effect=FileNotFoundError("rerun"))
    monkeypatch.setattr(opening, "open_viewer", missing)
    with live(tmp_path) as viz:
        watch(viz, 20)
    missing.assert_called_once()
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


def test_pictures_of_a_film_come_at_the_cameras_own_times(tmp_path):
    writer = RunWriter(tmp_path, HEADER, "none", patient=True, film="libx264")
    writer.event(5.0, "origin")
    stamps = [0.06 * k + 0.01 * (k % 3) - 0.2 for k in range(20)]
    for k, stamp in enumerate(stamps):
        image = np.full((64, 96, 3), 9 * k, np.uint8)
        writer.frame(Frame(stamp, stamp + 0.02, "made", k, image))
        writer.tick(replace(ARM, stamp=max(0.0, stamp + 0.2)), "FOLD")
    writer.finish({"outcome": "path_done"})
    shown = times(viz_from_run(writer.folder), "/world/camera/image/picture")
    assert shown[0] == 0.0
    assert np.diff(shown[1:]).min() > 0.1 - 0.02
    assert len(shown) >= 5


def test_live_view_without_a_screen_says_where_it_is_to_be_seen(monkeypatch, capsys):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    said_where("live")
    assert "rerun --connect" in capsys.readouterr().err
    said_where("save")
    assert capsys.readouterr().err == ""
    monkeypatch.setenv("DISPLAY", ":0")
    said_where("live")
    assert capsys.readouterr().err == ""
