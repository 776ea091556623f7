"""Runs exported to the formats of other programs come back as they were, to the last
bit.
"""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import av
import numpy as np
import pyarrow.parquet as pq
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from cell.record.exchange.export_runs import Format, export_runs
from cell.record.exchange.import_runs import import_runs
from cell.record.files import EVENTS
from cell.record.film import Film, FilmWriter
from cell.record.frames import FrameWriter
from cell.record.run import read_run
from drivers.base.errors import ConfigurationError
from drivers.base.types import Frame
from tests.support.foreign_tables import STAMPS, foreign, mapping
from tests.support.rooms import ROOT

ARRAYS = (
    "t",
    "x",
    "z",
    "pitch",
    "x_cmd",
    "z_cmd",
    "pitch_cmd",
    "hand_cmd",
    "contact_x",
    "contact_t",
    "f_x",
    "f_z",
)


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, ...]:
    place = tmp_path_factory.mktemp("runs")
    folders = [foreign(place / name) for name in ("a", "b")]
    made = import_runs(folders, mapping(place), place / "runs")
    for folder in made:
        (folder / EVENTS).write_text('{"t": 0.5, "kind": "fault", "name": "late"}\n')
        film = FrameWriter(folder, "key", patient=True, encoder="libx264")
        for i, stamp in enumerate(STAMPS.tolist()):
            film.put(
                Frame(stamp, stamp, "camera", i, np.full((64, 96, 3), 3 * i, np.uint8)),
                False,
            )
        film.close()
    return made


@pytest.mark.parametrize("kind", ["csv", "lerobot", "mcap"])
def test_exported_runs_come_back_bit_for_bit(
    runs, kind: Format, tmp_path: Path
) -> None:
    made = import_runs(
        export_runs(runs, kind, tmp_path / "out"), None, tmp_path / "back"
    )
    for was, now in zip(map(read_run, runs), map(read_run, made), strict=True):
        assert (now.name, now.header, now.result) == (was.name, was.header, was.result)
        for name in ARRAYS:
            assert np.array_equal(
                getattr(now.ticks, name), getattr(was.ticks, name), True
            ), name
        for name in ("t", "i", "x", "z"):
            assert np.array_equal(
                getattr(now.profile, name), getattr(was.profile, name)
            ), name
        if kind == "lerobot":
            stamps = [list(run.film_stamps().values()) for run in (was, now)]
            assert np.allclose(*stamps, atol=0.0101)  # s, between two rows


def test_a_data_set_has_the_layout_that_lerobot_states(runs, tmp_path: Path) -> None:
    [root] = export_runs(runs, "lerobot", tmp_path / "out")
    info = json.loads((root / "meta/info.json").read_text())
    assert info["codebase_version"] == "v3.0"
    assert (info["total_episodes"], info["total_frames"], info["fps"]) == (2, 600, 100)
    for row in pq.read_table(
        root / "meta/episodes/chunk-000/file-000.parquet"
    ).to_pylist():
        place = {key: row[f"data/{key}"] for key in ("chunk_index", "file_index")}
        frames = pq.read_table(root / info["data_path"].format(**place))
        assert {*frames.column_names, "observation.images.camera"} == set(
            info["features"]
        )
        indices = range(row["dataset_from_index"], row["dataset_to_index"])
        assert frames["index"].to_pylist() == list(indices)
        assert np.allclose(frames["timestamp"], np.arange(300) / 100)
    tasks = pq.read_table(root / "meta/tasks.parquet")
    assert json.loads(tasks.schema.metadata[b"pandas"])["index_columns"] == ["task"]
    assert set(json.loads((root / "meta/stats.json").read_text())) == set(
        info["features"]
    )
    place = {
        "chunk_index": 0,
        "file_index": 0,
        "video_key": "observation.images.camera",
    }
    film = list(Film(root / info["video_path"].format(**place)).frames())
    assert np.allclose([frame.stamp for frame in film], frames["timestamp"], atol=1e-4)
    newest = np.maximum(np.searchsorted(STAMPS, frames["stamp"], side="right") - 1, 0)
    assert frames["measured.camera_stamp"].to_pylist() == STAMPS[newest].tolist()
    assert np.allclose([frame.image.mean() for frame in film], 3 * newest, atol=6)


@pytest.mark.long
def test_a_data_set_opens_in_the_reference_loader_with_its_images(
    runs, tmp_path: Path
) -> None:
    [root] = export_runs(runs, "lerobot", tmp_path / "out")
    words = ["bash", ROOT / ".ci/loader", tmp_path / "loader", root, sys.executable]
    said = subprocess.run(words, check=True, capture_output=True, text=True).stdout
    stamps, levels = np.reshape(json.loads(said.splitlines()[-1]), (2, 12))
    newest = np.maximum(np.searchsorted(STAMPS, stamps, side="right") - 1, 0)
    assert np.allclose(levels, 3 * newest, atol=6)


def test_runs_of_two_strips_are_exported_where_each_states_its_own(
    runs, tmp_path
) -> None:
    folders = [runs[0], shutil.copytree(runs[1], tmp_path / "other")]
    head = folders[1] / "run.yaml"
    head.write_text(head.read_text().replace("denim", "linen"))
    made = import_runs(
        export_runs(folders, "lerobot", tmp_path / "out"), None, tmp_path / "back"
    )
    assert [read_run(folder).header.strip for folder in made] == ["denim", "linen"]
    with pytest.raises(ConfigurationError, match="in strip, start or sigma"):
        export_runs(folders, "csv", tmp_path / "csv")
    with FilmWriter(folders[1] / "film.mp4") as film:
        for stamp in STAMPS:
            film.add(stamp, np.zeros((32, 48, 3), np.uint8))
    with pytest.raises(ConfigurationError, match="images have another size"):
        export_runs(folders, "lerobot", tmp_path / "again")


def test_mcap_is_read_by_its_own_library(runs, tmp_path: Path) -> None:
    """Numbers as JSON; film, strip, gripper and events by the schemas that Foxglove
    draws.
    """
    made, run, drawn = (
        export_runs(runs, "mcap", tmp_path / "out"),
        read_run(runs[0]),
        {},
    )
    with made[0].open("rb") as file:
        reader = make_reader(
            file, validate_crcs=True, decoder_factories=[DecoderFactory()]
        )
        messages = [json.loads(m.data) for _, c, m in reader.iter_messages(["/ticks"])]
        for topic in ("/camera/film", "/strip", "/tf", "/log"):
            drawn[topic] = [each[3] for each in reader.iter_decoded_messages([topic])]
    assert [m["t"] for m in messages] == run.ticks.t.tolist()
    assert [m.translation.x for m in drawn["/tf"]] == run.ticks.x.tolist()
    assert [(m.level, m.message) for m in drawn["/log"]] == [(4, "fault, name late")]
    lines = [m.entities[0].lines[0].points for m in drawn["/strip"]]
    curves = [curve.tolist() for _, curve in run.profile.curves()]
    assert [[[point.x, point.z] for point in line] for line in lines] == curves
    film, decoder = drawn["/camera/film"], av.CodecContext.create("h264", "r")
    stamps = [m.timestamp.ToNanoseconds() / 1e9 - 3600 for m in film]
    assert np.allclose(stamps, STAMPS, atol=1e-6)
    pictures = [
        p for m in film for p in decoder.decode(av.Packet(m.data))
    ] + decoder.decode(None)
    levels = [picture.to_ndarray(format="gray").mean() for picture in pictures]
    assert np.allclose(levels, 3 * np.arange(len(STAMPS)), atol=6)


def test_a_file_whose_writer_was_killed_gives_its_whole_chunks(
    runs, tmp_path: Path
) -> None:
    [made, _] = export_runs(runs, "mcap", tmp_path / "out")
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(made.read_bytes()[:-4000])
    [folder] = import_runs([cut], None, tmp_path / "back")
    assert np.array_equal(read_run(folder).ticks.x, read_run(runs[0]).ticks.x)


@pytest.mark.parametrize("kind", ["lerobot", "mcap"])
def test_a_spoilt_export_is_refused_in_one_line(
    runs, kind: Format, tmp_path: Path
) -> None:
    made = export_runs(runs, kind, tmp_path / "out")
    path = made[0] if kind == "mcap" else made[0] / "data/chunk-000/file-000.parquet"
    content = bytearray(path.read_bytes())
    content[200:900] = bytes(700)
    path.write_bytes(bytes(content))
    with pytest.raises(ConfigurationError) as error:
        import_runs(made, None, tmp_path / "back")
    assert "\n" not in str(error.value)
    assert not list((tmp_path / "back").glob("*"))
