"""Export of runs as MCAP files with exact stamps, and import of any MCAP file, even
truncated.

Numbers of a run are JSON: a message for each row, and for each curve of the profile;
`t` is the exact stamp [s], the log time that of the file's nanoseconds. What Foxglove
draws has its schemas: film and kept images, the strip as a line, the gripper as a
transform, events as a log.
"""

import json
import struct
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from io import BytesIO
from itertools import groupby
from math import cos, isfinite, sin
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.CompressedVideo_pb2 import CompressedVideo
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from mcap.exceptions import EndOfFile, McapError
from mcap.records import Attachment, Channel, Chunk, McapRecord, Message, Schema
from mcap.stream_reader import StreamReader, get_chunk_data_stream
from mcap.writer import Writer
from mcap_protobuf.decoder import DecoderFactory as Protobuf
from mcap_protobuf.schema import register_schema
from mcap_ros2.decoder import DecoderFactory as Cdr
from zstandard import ZstdError

from cell.record.columns import was_set_back
from cell.record.events import EVERY_FRAME, log_text
from cell.record.exchange.mapping import (
    MAPPING,
    Source,
    Table,
    documents_of,
    mapping_of,
)
from cell.record.files import FILM
from cell.record.film import Film
from cell.record.frames import encode
from cell.record.run import Run
from cell.record.tables import TooLarge, check_width
from drivers.base.errors import ConfigurationError
from drivers.base.files import replacing
from drivers.base.readers import MEGABYTE, read_bytes
from drivers.base.types import Array

LARGEST_FILE = 1024 * MEGABYTE
LARGEST_CONTENT = 2 * LARGEST_FILE  # of messages, unpacked
MOST_VALUES = 30_000_000  # of a topic
NANOSECONDS = 1_000_000_000  # ns
# of log time at t = 0: an image from before has a time too
ATTACHMENT_TIME = 3600 * NANOSECONDS
LOG_TIME = "log_time"  # s, a column of every topic
# ROS 2, JSON, protobuf
TIMES = ({"nanosec", "sec"}, {"nsec", "sec"}, {"nanos", "seconds"})
Row = dict[str, Any]
Found = tuple[Message, Channel, Schema | None]


def write_mcap(runs: Sequence[Run], out: Path) -> tuple[Path, ...]:
    """Write one MCAP file for each of `runs` into the folder `out`, with YAML documents
    and mapping attached, and return their paths.
    """
    paths = tuple(out / f"{run.name}.mcap" for run in runs)
    for run, path in zip(runs, paths, strict=True):
        with replacing(path) as scratch, scratch.open("wb") as file:
            writer = Writer(file)
            writer.start(profile="", library="folding-cell")
            mapping = mapping_of([run], lambda table, column: (f"/{table}", column))
            for name, content in (documents_of(run) | {MAPPING: mapping}).items():
                stamps = ATTACHMENT_TIME, ATTACHMENT_TIME
                if content:
                    writer.add_attachment(*stamps, name, "application/yaml", content)
            _write_numbers(writer, run)
            _write_drawings(writer, run)
            writer.finish()
    return paths


def _write_numbers(writer: Writer, run: Run) -> None:
    """Write each table of `run` as a topic of an MCAP file, with one message for each
    row or, of points, for each image.
    """
    for table, columns in run.tables().items():
        numbers: Row = {name: {"type": "number"} for name in columns}
        if table == "profile":
            point = {"type": "object", "properties": numbers}
            numbers = {
                "t": numbers.pop("t"),
                "points": {"type": "array", "items": point},
            }
        text = json.dumps({"type": "object", "properties": numbers}).encode()
        schema = writer.register_schema(f"cell.{table}", "jsonschema", text)
        channel = writer.register_channel(f"/{table}", "json", schema)
        time = "t_layer_touch" if table == "result" else "t"
        rows = [
            {name: value for name, value in row.items() if isfinite(value)}
            for row in pa.table(dict(columns)).to_pylist()
        ]
        for message in _curves(rows) if table == "profile" else rows:
            moment = _log_time(message[time])
            writer.add_message(channel, moment, json.dumps(message).encode(), moment)


def _curves(points: list[Row]) -> Iterator[Row]:
    """Messages of the strip's midlines from the rows `points`: one for each image, with
    all of its points.
    """
    for t, group in groupby(points, lambda point: point["t"]):
        yield {
            "t": t,
            "points": [{k: v for k, v in point.items() if k != "t"} for point in group],
        }


def _write_drawings(writer: Writer, run: Run) -> None:
    """Write what a viewer can draw of `run` into an MCAP file, each kind as a topic of
    its own with a message schema of Foxglove.
    """
    channels: dict[str, int] = {}
    for topic, t, message in _drawings(run):
        if topic not in channels:
            schema = register_schema(writer, type(message))
            channels[topic] = writer.register_channel(topic, "protobuf", schema)
        moment = _log_time(t)
        of_time = message.entities[0] if topic == "/strip" else message
        of_time.timestamp.FromNanoseconds(moment)
        writer.add_message(channels[topic], moment, message.SerializeToString(), moment)


def _drawings(run: Run) -> Iterator[tuple[str, float, Any]]:
    """Yield topic, time [s] and message of everything of `run` that a viewer can draw:
    film, images, strip, gripper and events.
    """
    stamps = run.film_stamps()
    for number, data in enumerate(Film(run.folder / FILM).packets() if stamps else ()):
        if number in stamps:
            video = CompressedVideo(format="h264", data=data, frame_id="camera")
            yield "/camera/film", stamps[number], video
    for frame in run.frames():
        image = CompressedImage(
            format="png", data=encode(frame.image), frame_id="camera"
        )
        yield "/camera/image", frame.stamp, image
    for stamp, curve in run.profile.curves():
        points = [{"x": x, "z": z} for x, z in curve.tolist()]
        line = {
            "points": points,
            "thickness": 4,
            "scale_invariant": True,
            "color": {"a": 1},
        }
        entity: Any = {"frame_id": "cell", "id": "strip", "lines": [line]}
        yield "/strip", stamp, SceneUpdate(entities=[entity])
    ticks = run.ticks
    half_turns = np.nan_to_num(ticks.pitch) / 2  # about y, from x along the strip down
    for t, x, z, half in np.column_stack(
        [ticks.t, ticks.x, ticks.z, half_turns]
    ).tolist():
        pose = Row(
            translation={"x": x, "z": z}, rotation={"y": sin(half), "w": cos(half)}
        )
        yield (
            "/tf",
            t,
            FrameTransform(parent_frame_id="cell", child_frame_id="gripper", **pose),
        )
    for event in run.events():
        if event.kind not in EVERY_FRAME:
            level = Log.ERROR if event.kind == "fault" else Log.INFO
            text = log_text(event.kind, event.facts)
            yield "/log", event.t, Log(level=level, name=event.kind, message=text)


def _log_time(t: float) -> int:
    return max(ATTACHMENT_TIME + round(t * NANOSECONDS), 0)


class McapFile(Source):
    """Run of another program in an MCAP file, with a table for each topic; a file that
    was cut off gives what is whole in it.
    """

    def __init__(self, path: Path, parts: Sequence[Path] = ()) -> None:
        """Read attachments and names of topics from the MCAP file at `path` or, where
        it is a folder, from its MCAP files `parts`.
        """
        self.documents: dict[str, bytes] = {}
        super().__init__(path, path.name.removesuffix(".mcap"), self.documents, ())
        self._decoders = Protobuf(), Cdr()
        self._contents = [read_bytes(each, LARGEST_FILE) for each in parts or [path]]
        topics = {topic for each in self._contents for topic in self._topics(each)}
        self.names = sorted(topics or {by.topic for _, by, _ in self._messages()})

    def table(self, how: Table[Any]) -> pa.Table:
        """Table of the messages of the topic that the entry `how` of a mapping names,
        with a row for each, in the order of their log times.

        Nested fields are joined by dots, numbers of a list have their index as name,
        and a list of objects gives a row for each. Rows without any of the wanted
        columns are left out. Raises ConfigurationError for a topic that is not there or
        cannot be decoded.
        """
        if (topic := how.file) not in self.names:
            raise self.missing(how)
        wanted = {column.column for column in how.columns.values()} - {LOG_TIME}
        rows, unread = self._rows(topic)
        useful = [row for row in rows if wanted & row.keys()]
        if useful and len(useful) < len(rows):
            self.remarks.append(
                f"{self.path}: {topic}: {len(rows) - len(useful)} of {len(rows)}"
                " messages are of others, and are passed over"
            )
        if unread and not useful:
            raise ConfigurationError(
                f"{self.path}: topic {topic!r}: its messages are"
                f" {', '.join(sorted(unread))}; JSON, protobuf, and CDR with a schema"
                " in ros2msg are read"
            )
        names = dict.fromkeys(name for row in useful or rows for name in row)
        return pa.table(
            {n: _column([row.get(n) for row in useful or rows]) for n in names}
        )

    def _rows(self, topic: str) -> tuple[list[Row], set[str]]:
        """Rows from all messages of `topic`, and the names of the encodings of those
        that cannot be decoded.
        """
        found = (each for each in self._messages() if each[1].topic == topic)
        if (first := next(found, None)) is None:
            return [], set()
        self._parts(*first)  # refuses what is too wide before all of it is unpacked
        of_topic = [first, *found]
        for writer in {by.id for _, by, _ in of_topic}:
            times = [each.log_time for each, by, _ in of_topic if by.id == writer]
            self._check_clock(np.array(times) / NANOSECONDS, topic)

        rows: list[Row] = []
        unread: set[str] = set()
        values = 0
        in_time = sorted(of_topic, key=lambda each: each[0].log_time)
        for message, by, schema in in_time:
            parts = self._parts(message, by, schema)
            if parts is None:
                kind = schema.encoding if schema else ""
                unread.add(f"{by.message_encoding} {kind}".strip())
                continue
            values += sum(map(len, parts))
            if values > MOST_VALUES:
                raise TooLarge(
                    f"{self.path}: topic {topic!r}: holds over {MOST_VALUES} values;"
                    " cut the recording, or leave point clouds out"
                )
            logged = {LOG_TIME: message.log_time / NANOSECONDS}
            rows += [row | logged for row in parts]
        return rows, unread

    def _parts(
        self, message: Message, channel: Channel, schema: Schema | None
    ) -> list[Row] | None:
        """Rows from one message, or None where its encoding cannot be read;
        ConfigurationError where it is broken or too wide.
        """
        encoding = channel.message_encoding
        origin = f"{self.path}: topic {channel.topic!r}"
        try:
            known = (each.decoder_for(encoding, schema) for each in self._decoders)
            decode = (
                json.loads if encoding == "json" else next(filter(None, known), None)
            )
            parts = None if decode is None else flat(decode(message.data))
        except Exception as error:  # noqa: BLE001  whatever a decoder raises for foreign bytes
            raise ConfigurationError(
                f"{origin}: a message is not whole {encoding}: {error}"
            ) from None
        check_width(max(map(len, parts or [{}])), origin)
        return parts

    def _check_clock(self, t: Array, topic: str) -> None:
        """Raise ConfigurationError where the times `t` [s] of a topic's messages show
        that the clock of their writer was set back.
        """
        if was_set_back(t):
            last = t[int(np.argmin(np.diff(t)))]
            raise ConfigurationError(
                f"{self.path}: topic {topic!r}: the clock was set back after"
                f" {last - t[0]:.3g} s: cut the recording there"
            )

    def _topics(self, content: bytes) -> Iterator[str]:
        """Yield the names of the topics that the summary of an MCAP file lists, and
        keep the attachments that it lists.

        A file whose writer was killed has no summary, and yields none.
        """
        try:
            for record in _stored(content):
                if isinstance(record, Attachment):
                    self.documents[record.name] = record.data
                elif isinstance(record, Channel):
                    yield record.topic
        except (McapError, struct.error):
            return  # what is wrong with it is said where its messages are read

    def _messages(self) -> Iterator[Found]:
        """Yield all messages, in the order of the files, each with its channel and its
        schema.
        """
        for content in self._contents:
            yield from self._messages_in(content)

    def _messages_in(self, content: bytes) -> Iterator[Found]:
        """Yield the messages in the `content` of one MCAP file, each with its channel
        and its schema.
        """
        schemas: dict[int, Schema] = {}
        channels: dict[int, Channel] = {}
        try:
            for record in self._records(content):
                if isinstance(record, Schema):
                    schemas[record.id] = record
                elif isinstance(record, Channel):
                    channels[record.id] = record
                elif isinstance(record, Message):
                    channel = channels[record.channel_id]
                    yield record, channel, schemas.get(channel.schema_id)
        except (EndOfFile, struct.error):  # its writer was killed
            return
        except (McapError, ZstdError, KeyError, ValueError, RuntimeError) as error:
            raise ConfigurationError(
                f"{self.path}: is not an MCAP file that can be read: {error}"
            ) from None

    def _records(self, content: bytes) -> Iterator[McapRecord]:
        """Yield the records in the `content` of an MCAP file, and those within its
        compressed chunks one by one.
        """
        left = LARGEST_CONTENT
        for record in _stored(content):
            if not isinstance(record, Chunk):
                yield record
                continue
            left -= record.uncompressed_size
            if left < 0:
                raise TooLarge(
                    f"{self.path}: holds over {LARGEST_CONTENT // MEGABYTE} MB of"
                    " messages; cut the recording"
                )
            unpacked, _ = get_chunk_data_stream(record)
            with suppress(EndOfFile):
                yield from StreamReader(unpacked, skip_magic=True).records


def _stored(content: bytes) -> Iterator[McapRecord]:
    """Yield the records in the `content` of an MCAP file, with its chunks still
    compressed.
    """
    reader = StreamReader(
        BytesIO(content), emit_chunks=True, record_size_limit=LARGEST_FILE
    )
    yield from reader.records


def flat(message: object) -> list[Row]:
    """Rows of plain values from a decoded message: one for each object in its lists or,
    where it has no such list, a single row.
    """
    scalars: Row = {}
    rows: list[Row] = []
    for name, value in _fields(message).items():
        inner = _fields(value)
        if isinstance(value, Sequence) and not isinstance(value, str | bytes):
            objects = [(i, item) for i, item in enumerate(value) if _fields(item)]
            parts = [{"i": i, **row} for i, item in objects for row in flat(item)]
            names = {str(row["name"]) for row in parts if "name" in row}
            if len(names) < max(len(parts), 1):
                rows += parts
                parts = []
            for part in parts:  # each has a name of its own
                scalars |= {f"{key}.{part['name']}": v for key, v in part.items()}
            scalars |= {
                f"{name}.{i}": item for i, item in enumerate(value) if not _fields(item)
            }
        elif inner.keys() in TIMES:
            nanoseconds, seconds = (inner[part] for part in sorted(inner))
            scalars[name] = seconds + 1e-9 * nanoseconds
        elif inner:
            nested = [
                {f"{name}.{key}": part for key, part in row.items()}
                for row in flat(value)
            ]
            if len(nested) == 1:
                scalars |= nested[0]
            else:
                rows += nested
        else:
            scalars[name] = value
    return [scalars | row for row in rows] or [scalars]


def _fields(value: Any) -> Mapping[str, Any]:
    """Fields of an object that was decoded from JSON, protobuf or ROS 2, by name; empty
    for a value that has no fields.

    Protobuf does not send a zero: a field is missing only where it can say so.
    """
    if isinstance(value, Mapping):
        return value
    if (kind := getattr(value, "DESCRIPTOR", None)) is None:
        return {name: getattr(value, name) for name in getattr(value, "__slots__", ())}
    return {
        field.name: getattr(value, field.name)
        for field in kind.fields
        if not field.has_presence or value.HasField(field.name)
    }


def _column(values: list[Any]) -> pa.Array:
    try:
        return pa.array(values)
    except (pa.ArrowException, TypeError, OverflowError):  # of several types
        return pa.array(list(map(str, values)))
