import json
import shutil
import subprocess
import sys
import threading
from dataclasses import astuple, replace
from pathlib import Path

import numpy as np
import pytest

from cell.record import frames, tables, writer as record_writer
from cell.record.files import EVENTS, PROFILE, SIGHTS, TICKS
from cell.record.run import read_run
from cell.record.writer import RunWriter
from drivers.base.errors import Fault
from drivers.base.types import Frame
from tests.cell.conftest import HEADER, RESULT
from tests.support.dying import no_room
from tests.support.plain_cell import ARM
from tests.support.refusals import refusal


def small_frame(sequence: int) -> Frame:
    image = np.full((4, 6, 3), sequence % 256, np.uint8)
    return Frame(0.01 * sequence, 0.01 * sequence + 0.02, "made", sequence, image)


def hand_over_and_finish(writer: RunWriter, count: int) -> None:
    for sequence in range(count):
        writer.frame(small_frame(sequence))
    writer.finish({"outcome": "path_done"})


def test_any_cut_of_the_streams_can_still_be_read(killed, tmp_path):
    for name in ("ticks.arrows", "sights.arrows"):
        content = (killed / name).read_bytes()
        for size in (0, 1, 60, 700, len(content) // 3, len(content) - 9):
            folder = shutil.copytree(killed, tmp_path / f"{name}-{size}")
            (folder / name).write_bytes(content[:size])
            run = read_run(folder)
            assert run.died
            assert run.sights().stamp.size <= 43


def test_same_fold_gives_the_same_bytes(make_run, tmp_path):
    first, second = make_run(tmp_path), make_run(tmp_path)
    for name in (TICKS, PROFILE, SIGHTS, EVENTS, frames.INDEX):
        assert (first / name).read_bytes() == (second / name).read_bytes(), name


def test_a_killed_run_reads_as_one_that_lived(make_run, tmp_path, monkeypatch):
    whole = read_run(make_run(tmp_path / "lived"))
    monkeypatch.setattr(RunWriter, "finish", lambda writer, _: writer.close())
    broken = read_run(make_run(tmp_path / "killed"))
    assert broken.died
    for name in ("ticks", "profile"):
        columns = (astuple(getattr(run, name)) for run in (whole, broken))
        for one, other in zip(*columns, strict=True):
            np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("last", ["write_tables", "write_document", "unlink"])
def test_a_kill_while_a_run_is_completed_loses_no_row_and_it_may_be_tried_again(
    tmp_path, monkeypatch, last
):
    writer = RunWriter(tmp_path, HEADER, "none")
    for k in range(200):
        writer.tick(replace(ARM, stamp=0.01 * k), "FOLD")
        writer.event(0.01 * k, "turn", k=k)

    def killed(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    owner = {"unlink": Path, "write_tables": tables}.get(last, record_writer)
    with monkeypatch.context() as patched:
        patched.setattr(owner, last, killed)
        with pytest.raises(KeyboardInterrupt):
            writer.finish(RESULT)
    run = read_run(writer.folder)
    assert (run.ticks.t.size, len(run.events())) == (200, 200)
    for _ in range(2):
        writer.finish(RESULT)
    assert read_run(writer.folder).result.displacement == RESULT["displacement"]
    assert not [*writer.folder.glob("*.arrows")]


@pytest.mark.parametrize(("stamps", "x"), [((0.07, 0.11), 0.4), ((0.09, 0.14), 0.3)])
def test_of_two_contacts_in_one_row_the_nearer_is_placed(stamps, x):
    rows = np.arange(4) / 10
    placed, _ = tables.place_contacts(rows, np.array(stamps), np.array([0.3, 0.4]))
    np.testing.assert_equal(placed, [np.nan, x, np.nan, np.nan])


def test_lines_of_events_are_plain_json_without_nan(tmp_path):
    writer = RunWriter(tmp_path, HEADER, "none")
    writer.event(0.1, "sight", gap=float("nan"), n=np.int64(3), at=np.array([1.0, 2.0]))
    writer.close()
    line = json.loads((writer.folder / "events.jsonl").read_text())
    assert line == {"t": 0.1, "kind": "sight", "gap": None, "n": 3, "at": [1.0, 2.0]}


def test_folder_that_cannot_be_written_is_one_line_before_the_run(tmp_path):
    blocked = tmp_path / "runs"
    blocked.write_text("a file")
    with refusal("cannot be recorded here") as caught:
        RunWriter(blocked, HEADER)
    assert "\n" not in str(caught.value)


def test_disk_that_fills_up_stops_the_run_and_keeps_what_it_took(tmp_path):
    script = f"""
import resource, signal
from pathlib import Path
from tests.support.plain_cell import ARM, replace
from cell.record.writer import RunWriter
from drivers.base.errors import Fault
writer = RunWriter(Path({str(tmp_path)!r}), {HEADER!r}, "none")
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (40_000, 40_000))
try:
    for k in range(1000):
        writer.tick(replace(ARM, stamp=0.01 * k), "FOLD")
except Fault as fault:
    print(fault.name, k)
"""
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, check=False
    )
    name, written = done.stdout.split()
    assert name == b"record"
    run = read_run(*tmp_path.iterdir())
    assert run.died
    assert run.ticks.t.size == int(written) > 10


def test_two_runs_of_one_second_and_chance_get_folders_of_their_own(
    tmp_path, monkeypatch
):
    drawn = iter(["aaaa", "aaaa", "aaaa", "bbbb"])
    monkeypatch.setattr("secrets.token_hex", lambda count: next(drawn))
    writers = [RunWriter(tmp_path, HEADER, "none") for _ in range(2)]
    assert writers[0].folder != writers[1].folder
    for writer in writers:
        writer.close()


def test_image_that_cannot_be_written_is_a_fault_once_and_never_blocks(
    tmp_path, monkeypatch
):
    writer = RunWriter(tmp_path, HEADER, "all", patient=True)

    monkeypatch.setattr(frames, "encode", no_room)
    with pytest.raises(Fault, match="No space left"):
        hand_over_and_finish(writer, 200)
    assert not (writer.folder / "result.yaml").exists()
    writer.finish({"outcome": "record"})
    assert read_run(writer.folder).result.outcome == "record"


def test_every_image_is_kept_bit_for_bit_when_asked(tmp_path):
    rng = np.random.default_rng(3)
    frames = [
        replace(small_frame(k), image=rng.integers(0, 256, (36, 64, 3), np.uint8))
        for k in range(40)
    ]
    writer = RunWriter(tmp_path, HEADER, "all", patient=True)
    for frame in frames:
        writer.frame(frame)
    writer.finish({"outcome": "path_done"})
    back = list(read_run(writer.folder).frames())
    assert [frame.sequence for frame in back] == list(range(40))
    assert all(
        np.array_equal(a.image, b.image) for a, b in zip(frames, back, strict=True)
    )
    assert [b.stamp for b in back] == [f.stamp for f in frames]


@pytest.mark.parametrize(("keep", "fewest", "most"), [("key", 3, 3), ("none", 0, 0)])
def test_every_image_is_in_the_index_and_few_are_kept(tmp_path, keep, fewest, most):
    writer = RunWriter(tmp_path, HEADER, keep, patient=True)
    for k in range(500):
        if k == 320:
            writer.event(0.01 * k, "fault", name="force")
        writer.frame(small_frame(k))
    writer.finish({"outcome": "path_done"})
    notes = read_run(writer.folder).frame_index()
    kept = [note.sequence for note in notes if note.file is not None]
    assert [note.sequence for note in notes] == list(range(500))
    assert all(len(note.sha256) == 64 for note in notes if note.file is not None)
    assert fewest <= len(kept) <= most
    if keep == "key":
        assert kept == [0, 320, 499]


def test_slow_disk_on_hardware_loses_images_but_not_their_place(tmp_path, monkeypatch):
    writer = RunWriter(tmp_path, HEADER, "all")
    encode, gate = frames.encode, threading.Event()

    def slow(image):
        gate.wait()
        return encode(image)

    monkeypatch.setattr(frames, "encode", slow)
    for k in range(frames.QUEUE + 20):
        writer.frame(small_frame(k))
    gate.set()
    writer.finish({"outcome": "path_done"})
    notes = read_run(writer.folder).frame_index()
    assert len(notes) == frames.QUEUE + 20
    assert 18 <= sum(not note.sha256 for note in notes) <= 20
