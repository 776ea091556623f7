"""Files as other programs write them: read rightly, or refused by the right name."""

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import cv2
import numpy as np
import pyarrow.parquet as pq
import pytest
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from google.protobuf.descriptor_pb2 import UninterpretedOption
from mcap.writer import Writer
from mcap_protobuf.schema import register_schema
from mcap_ros2.writer import Writer as RosWriter

import cell
from cell.record.exchange.export_runs import export_runs
from cell.record.exchange.import_runs import import_runs
from cell.record.film import Film, FilmWriter
from cell.record.run import read_run
from drivers.base.errors import ConfigurationError
from tests.support.foreign_tables import T, X, Z, in_metres, plain

ROWS = [(round((t + 7.0) * 1e9), x, z) for t, x, z in zip(T, X, Z, strict=True)]
INTEGERS = ("double_value", "positive_int_value", "negative_int_value")
MICROMETRES = {"x": {"unit": "um"}, "z": {"unit": "um", "reversed": True}}


def how(place: Path, file: str, names: tuple[str, ...], **change: Any) -> Path:
    """A mapping for t, x and z by their `names`, of gripper and midline, with a
    `change`.
    """
    named = zip("txz", names, "smm", strict=True)
    columns = {
        k: {"column": name, "unit": u} | change.get(k, {}) for k, name, u in named
    }
    table = {"file": file, "columns": columns}
    return in_metres(place, ticks=table, profile=table, result=None)


def off(files: list[Path], mapping: Path, out: Path) -> float:
    """Largest difference of the imported run from the motion that was written [s,
    m].
    """
    ticks = read_run(*import_runs(files, mapping, out)).ticks
    return float(np.abs(np.subtract([ticks.t, ticks.x, ticks.z], [T, X, Z])).max())


def pose(at: int, x: float, z: float) -> PoseInFrame:
    """At a time of nanoseconds; z begins at 0, which proto3 does not send."""
    found = PoseInFrame(frame_id="cell")
    found.timestamp.FromNanoseconds(at)
    found.pose.position.x, found.pose.position.z = x, z
    return found


def integers(at: int, x: float, z: float) -> UninterpretedOption:
    """Lengths as integers of 64 bits [um], with and without sign."""
    lengths = {
        "positive_int_value": round(1e6 * x),
        "negative_int_value": round(-1e6 * z),
    }
    return UninterpretedOption(double_value=at / 1e9, **lengths)


def protobuf(message: Callable[..., Any], file: BinaryIO) -> None:
    writer = Writer(file)
    writer.start()
    schema = register_schema(writer, type(message(*ROWS[0])))
    place = writer.register_channel("/tip", "protobuf", schema)
    for row in ROWS:
        writer.add_message(place, 0, message(*row).SerializeToString(), 0)
    writer.finish()


def ros(file: BinaryIO) -> None:
    writer = RosWriter(file)
    schema = writer.register_msgdef(
        "own/Tip", "builtin_interfaces/Time stamp\nfloat64[3] point"
    )
    for at, x, z in ROWS:
        stamp = dict(zip(("sec", "nanosec"), divmod(at, 10**9), strict=True))
        writer.write_message("/tip", schema, {"stamp": stamp, "point": [x, 0.0, z]})
    writer.finish()


def mixed(
    file: BinaryIO, encodings: tuple[str, ...] = ("json", "json", "cbor")
) -> None:
    """Lists of numbers, two of them swapped in the file; other messages on the same
    topic.
    """
    writer = Writer(file)
    writer.start()
    first, *others = (
        writer.register_channel("/tip", encoding, 0) for encoding in encodings
    )
    for at, x, z in (*ROWS[:5], ROWS[6], ROWS[5], *ROWS[7:]):
        writer.add_message(first, at, json.dumps({"q": [x, z]}).encode(), at)
        for other in others:
            writer.add_message(other, at + 5, b'{"battery": 0.5}', at + 5)
    writer.finish()


@pytest.mark.parametrize(
    ("write", "names", "change"),
    [
        (
            partial(protobuf, pose),
            ("timestamp", "pose.position.x", "pose.position.z"),
            {},
        ),
        (partial(protobuf, integers), INTEGERS, MICROMETRES),
        (ros, ("stamp", "point.0", "point.2"), {}),
        (mixed, ("log_time", "q.0", "q.1"), {}),
    ],
)
def test_messages_of_other_programs_are_read(tmp_path, write, names, change) -> None:
    with (tmp_path / "a.mcap").open("wb") as file:
        write(file)
    mapping = how(tmp_path, "/tip", names, **change)
    assert off([tmp_path / "a.mcap"], mapping, tmp_path / "runs") < 1e-6


def test_an_encoding_that_is_not_read_is_named(tmp_path: Path) -> None:
    with (tmp_path / "a.mcap").open("wb") as file:
        mixed(file, ("cbor",))
    with pytest.raises(ConfigurationError, match="topic '/tip': its messages are cbor"):
        import_runs([tmp_path / "a.mcap"], how(tmp_path, "/tip", "txz"), tmp_path)


def test_paths_and_names_of_a_data_set_are_those_that_it_states(tmp_path: Path) -> None:
    made = import_runs([plain(tmp_path / "a")], in_metres(tmp_path), tmp_path / "runs")
    [root] = export_runs(made, "lerobot", tmp_path / "out")
    info = json.loads((root / "meta/info.json").read_text())
    info["data_path"] = "frames-{file_index:04d}-{chunk_index}.parquet"
    motors = ["shoulder_lift.pos", "elbow_flex.pos"]
    info["features"]["observation.state"]["names"] = {"motors": motors}
    (root / "meta/info.json").write_text(json.dumps(info))
    (root / "data/chunk-000/file-000.parquet").rename(root / "frames-0000-0.parquet")
    names = ("timestamp", *(f"observation.state.{motor}" for motor in motors))
    assert off([root], how(tmp_path, "episode", names), tmp_path / "back") < 1e-6
    (root / "meta/info.json").write_text(
        json.dumps(info | {"data_path": "../{file_index}"})
    )
    with pytest.raises(ConfigurationError, match="leads out of the data set"):
        import_runs([root], how(tmp_path, "episode", names), tmp_path / "again")
    info["features"]["../../film"] = {"dtype": "video"}
    episodes = pq.read_table(root / "meta/episodes/chunk-000/file-000.parquet")
    for name in ("chunk_index", "file_index", "from_timestamp"):
        episodes = episodes.append_column(f"videos/../../film/{name}", [[0]])
    above = episodes.drop_columns("cell/name").append_column("cell/name", [[".."]])
    for rows, features, match in (
        (episodes, info["features"], r"video_path: .*leads out of the data set"),
        (above, {}, r"cell/name: '\.\.' is not the name of a folder"),
        (episodes, [], r"info\.json: features: "),
        (episodes, {"stamp": 1}, r"info\.json: features: "),
    ):
        pq.write_table(rows, root / "meta/episodes/chunk-000/file-000.parquet")
        (root / "meta/info.json").write_text(json.dumps(info | {"features": features}))
        with pytest.raises(ConfigurationError, match=match):
            import_runs([root], how(tmp_path, "episode", names), tmp_path / "again")


@pytest.mark.parametrize(
    ("head", "row", "decimal"),
    [
        ("sep=;\nt;x;z", "{:.3f};{:f};{:f}", "."),
        ("# two lines\n# {:.3f},{:f},{:f}\n# t,x,z", "{:.3f},{:f},{:f}", "."),
        ("# t;x;z", "{:.3f};{:f};{:f}", ","),
        ("# t\tx\tz\r\n\r", "{:.3f}\t{:f}\t{:f}\r", ","),
        ("\n# note\n\nt,x,z", "{:.3f},{:f},{:f}", "."),
        ("# t,x,z", "  {:.3f}, {:f}, {:f}", "."),
        ("t,x,z", " {:.3f},  {:f},  {:f}", "."),
        ("t;x;z;Höhe", "{:.3f};{:f};{:f};1", "."),
        ("Rig 4, by M.\nt;x;z\n#N/A;;", "31.01.2026 12:00:{:06.3f};{:f};{:f}", "."),
        ("t,x,z,a|b", "2026-01-31T12:00:{:06.3f}Z,{:f},{:f},1", "."),
        ("% log\nt,x,z\n# in metres", "2026-01-31 12:00:{:06.3f},{:f},{:f}", "."),
    ],
)
def test_comments_separators_and_times_of_a_table_are_read(
    tmp_path, head, row, decimal
) -> None:
    rows = [
        row.format(*each).replace(".", decimal) for each in zip(T, X, Z, strict=True)
    ]
    folder = plain(
        tmp_path / "a", head.format(T[0], X[0], Z[0]), rows, encoding="cp1252"
    )
    assert off([folder], in_metres(tmp_path), tmp_path / "runs") < 1e-6


@pytest.mark.parametrize(
    ("change", "mending"),
    [
        ({"x": {"reversed": True}}, "; reversed: false for x of ticks and profile"),
        (
            {"x": {"offset": 1.2}},
            "; reversed: false, offset: 0.0 for x of ticks and profile",
        ),
        (
            {"x": {"unit": "cm"}, "z": {"unit": "mm"}},
            "; unit: m for x and z of ticks and profile",
        ),
        (
            {"x": {"column": "z"}, "z": {"column": "x"}},
            "; swapped columns for x and z of ticks",
        ),
        (
            {"z": {"offset": 0.05}},
            "; reversed: false, offset: 0.0 for z of ticks and profile",
        ),
        (
            {"x": {"factor": 7.0}, "z": {"factor": 0.01}},
            "edge; `cell import --guess` proposes",
        ),
        ({"z": {"factor": 9.0}}, "edge; unit: cm for z of ticks and profile"),
    ],
)
def test_a_path_off_the_strip_is_refused_with_its_mending(
    tmp_path, change, mending
) -> None:
    mapping = how(tmp_path, "tip.csv", "txz", **change)
    with pytest.raises(ConfigurationError, match=r"flat start|half lie") as error:
        cell.import_runs([plain(tmp_path / "a")], tmp_path / "runs", mapping)
    assert mending in str(error.value).replace(" (tip.csv)", "")


def test_a_film_of_a_phone_held_the_other_way_stands_upright(tmp_path: Path) -> None:
    image, path = np.full((64, 96, 3), 128, np.uint8), tmp_path / "film.mp4"
    image[:20, :30] = 255
    with FilmWriter(path) as film:
        film.add(0.0, image)
    upright, turned = (
        (1, 0, 0, 0, 1, 0, 0, 0, 1 << 14),
        (0, 1, 0, -1, 0, 0, 0, 0, 1 << 14),
    )
    matrices = [
        (np.array(matrix) << 16).astype(">i4").tobytes() for matrix in (upright, turned)
    ]
    head, track, rest = path.read_bytes().partition(b"tkhd")
    path.write_bytes(head + track + rest.replace(*matrices, 1))
    [frame] = Film(path).frames()
    assert (
        np.abs(
            frame.image - cv2.rotate(image, cv2.ROTATE_90_CLOCKWISE).astype(float)
        ).mean()
        < 8
    )
