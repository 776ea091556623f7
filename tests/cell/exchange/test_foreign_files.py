"""Files as other programs write them: read rightly, or refused by the right name."""

import json
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import av
import numpy as np
import pyarrow as pa
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
from tests.support.foreign_tables import T, X, Z, in_metres, plain
from tests.support.refusals import refusal

MOTION = list(zip(T, X, Z, strict=True))
ROWS = [(round((t + 7.0) * 1e9), x, z) for t, x, z in MOTION]
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


def bring(
    place: Path, path: Path, names: Any = "txz", file: str = "tip.csv", **change: Any
) -> None:
    """Import the motion that was written, t, x and z by their `names`: it comes back."""
    mapping = how(place, file, tuple(names), **change)
    right(import_runs([path], mapping, place / f"runs of {names[2]}"))


def right(made: Sequence[Path]) -> None:
    """The one run that was made is the motion that was written."""
    ticks = read_run(*made).ticks
    off = np.abs(np.subtract([ticks.t, ticks.x, ticks.z], [T, X, Z]))
    assert off.max() < 1e-6


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


@contextmanager
def written(path: Path, **options: Any) -> Iterator[Writer]:
    """Writer of a file at `path`, which is finished after the block."""
    with path.open("wb") as file:
        writer = Writer(file, **options)
        writer.start()
        yield writer
        writer.finish()


def protobuf(message: Callable[..., Any], path: Path) -> None:
    with written(path) as writer:
        schema = register_schema(writer, type(message(*ROWS[0])))
        place = writer.register_channel("/tip", "protobuf", schema)
        for row in ROWS:
            writer.add_message(place, 0, message(*row).SerializeToString(), 0)


def ros(path: Path) -> None:
    with RosWriter(str(path)) as writer:
        schema = writer.register_msgdef(
            "own/Tip", "builtin_interfaces/Time stamp\nfloat64[3] point"
        )
        for at, x, z in ROWS:
            stamp = dict(zip(("sec", "nanosec"), divmod(at, 10**9), strict=True))
            writer.write_message("/tip", schema, {"stamp": stamp, "point": [x, 0.0, z]})


def mixed(path: Path, encodings: tuple[str, ...] = ("json", "json", "cbor")) -> None:
    """Lists of numbers, two of them swapped in the file; other messages on the same
    topic.
    """
    with written(path) as writer:
        first, *others = (
            writer.register_channel("/tip", encoding, 0) for encoding in encodings
        )
        for at, x, z in (*ROWS[:5], ROWS[6], ROWS[5], *ROWS[7:]):
            writer.add_message(first, at, json.dumps({"q": [x, z]}).encode(), at)
            for other in others:
                writer.add_message(other, at + 5, b'{"battery": 0.5}', at + 5)


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
    path = tmp_path / "a.mcap"
    write(path)
    bring(tmp_path, path, names, "/tip", **change)


def test_an_encoding_that_is_not_read_is_named(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    mixed(path, ("cbor",))
    with refusal("topic '/tip': its messages are cbor"):
        bring(tmp_path, path, file="/tip")


def test_paths_and_names_of_a_data_set_are_those_that_it_states(tmp_path: Path) -> None:
    made = import_runs([plain(tmp_path / "a")], in_metres(tmp_path), tmp_path / "runs")
    [root] = export_runs(made, "lerobot", tmp_path / "out")
    about = root / "meta/info.json"
    info = json.loads(about.read_text())
    info["data_path"] = "frames-{file_index:04d}-{chunk_index}.parquet"
    motors = ["shoulder_lift.pos", "elbow_flex.pos"]
    info["features"]["observation.state"]["names"] = {"motors": motors}
    about.write_text(json.dumps(info))
    (root / "data/chunk-000/file-000.parquet").rename(root / "frames-0000-0.parquet")
    names = ("timestamp", *(f"observation.state.{motor}" for motor in motors))
    bring(tmp_path, root, names, "episode")
    about.write_text(json.dumps(info | {"data_path": "../{file_index}"}))
    with refusal("leads out of the data set"):
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
        about.write_text(json.dumps(info | {"features": features}))
        with refusal(match):
            import_runs([root], how(tmp_path, "episode", names), tmp_path / "again")


def test_data_set_of_an_older_version_is_refused_with_its_conversion(tmp_path) -> None:
    (tmp_path / "meta").mkdir()
    (tmp_path / "meta/info.json").write_text('{"codebase_version": "v2.1"}')
    with refusal(r"is 'v2\.1', must be v3\.x; convert it"):
        bring(tmp_path, tmp_path, file="episode")


@pytest.mark.parametrize(
    ("head", "row", "decimal"),
    [
        ("sep=;\nt;x;z", "{:.3f};{:f};{:f}", "."),
        ("# two lines\n# {:.3f},{:f},{:f}\n# t,x,z", "{:.3f},{:f},{:f}", "."),
        ("# t;x;z", "{:.3f};{:f};{:f}", ","),
        ("# t\tx\tz\r\n\r", "{:.3f}\t{:f}\t{:f}\r", ","),
        ("# t,x,z", "  {:.3f}, {:f}, {:f}", "."),
        ("t;x;z;Höhe", "{:.3f};{:f};{:f};1", "."),
        ("Rig 4, by M.\nt;x;z\n#N/A;;", "31.01.2026 12:00:{:06.3f};{:f};{:f}", "."),
        ("t,x,z,a|b", "2026-01-31T12:00:{:06.3f}Z,{:f},{:f},1", "."),
        ("# t x z", "{:.3e} {:.6e} {:.6e}", "."),
        ("t x z", " {:.3f}   {:f} {:f}", ","),
        ("%t,x,z,joint", "{:.3f},{:f},{:f},elbow", "."),
        ("t, x, z, q", "{:.3f} sec,{:f} m,{:f} m,0", "."),
        ("Version,1.2\nSerial,7,8\n,12,13\nt,x,z", "{:.3f},{:f},{:f}", "."),
        ("% log\nt,x,z\n# in metres", "2026-01-31 12:00:{:06.3f},{:f},{:f}", "."),
    ],
)
def test_comments_separators_and_times_of_a_table_are_read(
    tmp_path, head, row, decimal
) -> None:
    rows = [row.format(*each).replace(".", decimal) for each in MOTION]
    folder = plain(
        tmp_path / "a", head.format(T[0], X[0], Z[0]), rows, encoding="cp1252"
    )
    bring(tmp_path, folder)


def test_names_of_a_heading_with_numbers_are_those_of_its_rows(tmp_path) -> None:
    head = """Format Version,1.23,Length Units,Meters

,Type,Body,Body
,Name,tip,tip
,ID,"7","7"
,,Position,Position
Frame,Time (Seconds),X,Y"""
    rows = [f"{i},{t:.3f},{x:f},{z:f}" for i, (t, x, z) in enumerate(MOTION)]
    names = ("Time (Seconds)", "Body tip 7 Position X", "Body tip 7 Position Y")
    bring(tmp_path, plain(tmp_path / "a", head, rows), names)


def test_columns_without_names_have_numbers_and_doubled_ones_too(tmp_path) -> None:
    rows = [f"{t:.3f} {x:f} {z:f}" for t, x, z in MOTION]
    bare = plain(tmp_path / "a", rows[0], rows[1:])
    bring(tmp_path, bare, "012")
    doubled = plain(tmp_path / "b", "t q q", rows)
    bring(tmp_path, doubled, ("t", "q (1)", "q (2)"))
    with refusal("stands there 2 times; write 'q' with"):
        bring(tmp_path, doubled, "tqq")


def test_a_unit_in_the_cells_is_that_of_the_mapping(tmp_path) -> None:
    rows = [f"{t:.3f},{1e3 * x:f} mm,{z:f}" for t, x, z in MOTION]
    folder = plain(tmp_path / "a", "t,x,z", rows)
    with refusal(r"its cells are in mm, .*write unit: mm"):
        bring(tmp_path, folder)


def test_a_clock_that_was_set_back_is_no_matter_of_sorting(tmp_path) -> None:
    """Neighbours and pieces that changed places are."""
    for order, said in (
        (np.r_[0:200, 100:300], "the clock was set back by 1 s: cut the run there"),
        (np.r_[0:100, 99, 100:300], "keep one row for each time"),
        (np.r_[0:100, 101, 100, 102:300], "sort the rows"),
        (np.r_[150:300, 0:150], "sort the rows"),
        (np.random.default_rng(0).permutation(300), "sort the rows"),
    ):
        rows = [f"{T[i]:.3f},{X[i]:f},{Z[i]:f}" for i in order]
        folder = plain(tmp_path / said / str(order[120]), rows=rows)
        with refusal(f"times must increase; {said}"):
            import_runs([folder], in_metres(tmp_path), tmp_path / "runs")
    path = tmp_path / "a.mcap"
    log(path, [(t - (t > 2.0), {"q": 0.0}) for t in T])
    with refusal("set back after 2 s: cut the recording"):
        bring(tmp_path, path, ("log_time", "q", "q"), "/tip")


def log(path: Path, messages: list[tuple[float, Any]]) -> None:
    """Write messages of the topic /tip at times [s] as JSON."""
    with written(path) as writer:
        topic = writer.register_channel("/tip", "json", 0)
        for t, message in messages:
            at, text = round(1e9 * (t + 5.0)), json.dumps(message).encode()
            writer.add_message(topic, at, text, at)


@pytest.mark.parametrize(
    "state",
    [
        lambda names, places: {"name": names, "position": places},
        lambda names, places: {"joint_names": names, "position": places},
        lambda names, places: {
            "joints": [
                {"name": n, "position": p} for n, p in zip(names, places, strict=True)
            ]
        },
    ],
)
def test_parts_of_a_list_are_found_by_their_names(tmp_path, state) -> None:
    """In the order of each message, among those of another publisher."""
    messages = [(t + 0.005, state(["hand"], [0.1])) for t in T]
    for i, (t, x, z) in enumerate(MOTION):
        parts = {"along": x, "up": z} if i % 3 else {"up": z, "along": x}
        messages.append((t, state([*parts], [*parts.values()])))
    files, told = [tmp_path / "a.mcap"], []
    log(*files, sorted(messages, key=lambda message: message[0]))
    names = ("log_time", "position.along", "position.up")
    [made] = import_runs(
        files, how(tmp_path, "/tip", names), tmp_path / "runs", tell=told.append
    )
    ticks = read_run(made).ticks
    assert np.allclose([ticks.t, ticks.x, ticks.z], [T, X, Z], atol=1e-6)
    assert "300 of 600" in told[0]
    with refusal(r"later|not there"):
        bring(tmp_path, *files, ("log_time", "position.0", "position.1"), "/tip")


def test_names_in_the_rows_of_a_table_tell_its_parts(tmp_path) -> None:
    """As `rostopic echo -p` writes them."""
    rows = [
        f"{t:.3f},along,up,{x:f},{z:f}" if i % 2 else f"{t:.3f},up,along,{z:f},{x:f}"
        for i, (t, x, z) in enumerate(MOTION)
    ]
    head = "%time,field.name0,field.name1,field.position0,field.position1"
    folder = plain(tmp_path / "a", head, rows)
    bring(tmp_path, folder, ("time", "field.position.along", "field.position.up"))
    with refusal(r"choose parts by their names: field.position"):
        bring(tmp_path, folder, ("time", "field.position0", "field.position1"))


def test_a_folder_of_rosbag2_is_its_recording_in_all_parts(tmp_path) -> None:
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag/metadata.yaml").write_text("rosbag2_bagfile_information: {}")
    names = ("log_time", "x", "z")
    with refusal(r"without an .mcap file; convert it"):
        bring(tmp_path, tmp_path / "bag", names, "/tip")
    messages = [(t, {"x": x, "z": z}) for t, x, z in MOTION]
    log(tmp_path / "bag/bag_0.mcap", messages[:150])
    log(tmp_path / "bag/bag_1.mcap", messages[150:])
    bring(tmp_path, tmp_path / "bag", names, "/tip")


@pytest.mark.parametrize("file", ["tip.csv", "*.csv"])
@pytest.mark.parametrize("beside", ["notes.txt", "summary.csv"])
def test_a_text_file_beside_runs_is_told_and_passed_over(
    tmp_path, file, beside
) -> None:
    plain(tmp_path / "day/a")
    (tmp_path / "day" / beside).write_text("runs of Monday")
    told: list[str] = []
    mapping = how(tmp_path, file, tuple("txz"))
    import_runs([tmp_path / "day"], mapping, tmp_path / "runs", tell=told.append)
    assert told == [f"{tmp_path / 'day' / beside}: is no run, and is passed over"]


def test_the_film_of_several_picture_tracks_is_the_long_one(tmp_path) -> None:
    with av.open(str(tmp_path / "film.mp4"), "w") as film:
        tracks = {
            count: film.add_stream("libx264", rate=20, width=side, height=side)
            for count, side in ((1, 44), (20, 64))
        }
        for count, track in tracks.items():
            for i in range(count):
                picture = av.VideoFrame(track.width, track.height)
                picture.pts = i
                film.mux(track.encode(picture))
            film.mux(track.encode(None))
    frames = Film(tmp_path / "film.mp4").frames()
    assert [frame.image.shape for frame in frames] == 20 * [(64, 64, 3)]


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
    with refusal(r"flat start|half lie") as error:
        cell.import_runs([plain(tmp_path / "a")], tmp_path / "runs", mapping)
    assert mending in str(error.value).replace(" (tip.csv)", "")


def test_a_film_of_a_phone_held_the_other_way_stands_upright(tmp_path: Path) -> None:
    image, path = np.full((64, 96, 3), 128, np.uint8), tmp_path / "film.mp4"
    image[:20, :30] = 255
    with FilmWriter(path) as film:
        film.add(0.0, image)
    upright = np.diag([1, 1, 1 << 14])
    turned = np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1 << 14]])
    matrices = [(matrix << 16).astype(">i4").tobytes() for matrix in (upright, turned)]
    head, track, rest = path.read_bytes().partition(b"tkhd")
    path.write_bytes(head + track + rest.replace(*matrices, 1))
    [frame] = Film(path).frames()
    clockwise = np.rot90(image, -1).astype(float)
    assert np.abs(frame.image - clockwise).mean() < 8


@pytest.mark.parametrize(
    "file",
    ["tip.parquet", "tip.csv", pytest.param("a.mcap", marks=pytest.mark.slow)],
)
def test_what_is_too_wide_is_refused_by_its_count_and_soon(tmp_path, file) -> None:
    path = tmp_path / file
    if file == "a.mcap":
        with written(path, chunk_size=1 << 30) as writer:
            topic = writer.register_channel("/tip", "json", 0)
            for at in range(20_000):
                writer.add_message(topic, at, b'{"q":[' + b"0," * 19_999 + b"0]}", at)
    elif file == "tip.csv":
        head = ",".join(f"c{i}" for i in range(9_000))
        path.write_text("\n".join([head, *["0," * 8_999 + "0"] * 30]))
    else:
        pq.write_table(pa.table({"t": [0.0], "x": [[0.0] * 200_000]}), path)
    began = time.process_time()
    with refusal(r"holds \d+ columns, at most 4096"):
        bring(tmp_path, path, file="/tip" if file == "a.mcap" else file)
    assert time.process_time() - began < 2.0
