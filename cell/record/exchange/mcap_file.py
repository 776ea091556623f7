"""Export of runs as MCAP files with exact stamps, and import of any MCAP file, even truncated.

A message of a run is JSON; its `t` is the exact stamp [s], the log time that of the file's
nanoseconds. Kept images and the camera are messages of Foxglove's own schemas.
"""

import json
import struct
from collections.abc import Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa

from cell.record.documents import plain
from cell.record.exchange.mapping import MAPPING
from cell.record.exchange.run_tables import RunTables, mapping_of
from cell.record.files import CALIBRATION, RESULT, RUN
from cell.record.frames import encode
from drivers.errors import ConfigurationError, suggestion
from drivers.files import replacing
from drivers.readers import MEGABYTE, read_bytes
from drivers.yaml_text import dump_yaml

if TYPE_CHECKING:
    from mcap.records import Channel, Schema
    from mcap.writer import Writer

LARGEST_FILE = 1024 * MEGABYTE
NANOSECONDS = 1_000_000_000  # ns
ATTACHMENT_TIME = 3600 * NANOSECONDS  # of log time at t = 0: an image from before has a time too
ATTACHED = (RUN, RESULT, CALIBRATION)
Row = dict[str, Any]


def write_mcap(parts: Sequence[RunTables], out: Path) -> tuple[Path, ...]:
    """Write a file for each run into the folder `out`, its mapping as an attachment."""
    return tuple(_write(part, out / f"{part.run.name}.mcap") for part in parts)


def _write(part: RunTables, path: Path) -> Path:
    """Write one run as an MCAP file, its documents and mapping as attachments."""
    from mcap.writer import Writer

    with replacing(path) as scratch, scratch.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="", library="folding-cell")
        for name in ATTACHED:
            if (part.run.folder / name).is_file():
                content = read_bytes(part.run.folder / name, MEGABYTE)
                writer.add_attachment(
                    ATTACHMENT_TIME, ATTACHMENT_TIME, name, "application/yaml", content
                )
        names = mapping_of([part], lambda table, column: (f"/{table}", column))
        text = dump_yaml(plain(names))
        writer.add_attachment(
            ATTACHMENT_TIME, ATTACHMENT_TIME, MAPPING, "application/yaml", text.encode()
        )
        _write_numbers(writer, part)
        _write_pictures(writer, part)
        writer.finish()
    return path


def _write_numbers(writer: "Writer", part: RunTables) -> None:
    for table, columns in part.tables.items():
        schema = {"type": "object", "properties": {name: {"type": "number"} for name in columns}}
        text = json.dumps(schema).encode()
        channel = writer.register_channel(
            f"/{table}", "json", writer.register_schema(f"cell.{table}", "jsonschema", text)
        )
        time = "t_layer_touch" if table == "result" else "t"
        for row in zip(*(values.tolist() for values in columns.values()), strict=True):
            message = dict(zip(columns, row, strict=True))
            finite = {name: value for name, value in message.items() if np.isfinite(value)}
            moment = _log_time(message[time])
            writer.add_message(channel, moment, json.dumps(finite).encode(), moment)


def _write_pictures(writer: "Writer", part: RunTables) -> None:
    """Write the kept images, preceded by the camera's lens."""
    from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
    from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
    from mcap_protobuf.schema import register_schema

    def channel(topic: str, kind: type[Any]) -> int:
        return int(writer.register_channel(topic, "protobuf", register_schema(writer, kind)))

    if (calibration := part.run.calibration()) is not None:
        lens = calibration.lens
        about = CameraCalibration(
            frame_id="camera", width=lens.width, height=lens.height,
            distortion_model="plumb_bob", K=np.ravel(lens.matrix).tolist(),
            D=np.ravel(lens.distortion).tolist(),
        )  # fmt: skip
        about.timestamp.FromNanoseconds(ATTACHMENT_TIME)
        place = channel("/camera/calibration", CameraCalibration)
        writer.add_message(place, ATTACHMENT_TIME, about.SerializeToString(), ATTACHMENT_TIME)
    place = channel("/camera/image", CompressedImage)
    for frame in part.run.frames():
        moment = _log_time(frame.stamp)
        picture = CompressedImage(frame_id="camera", format="png", data=encode(frame.image))
        picture.timestamp.FromNanoseconds(moment)
        writer.add_message(place, moment, picture.SerializeToString(), moment, frame.sequence)


def _log_time(t: float) -> int:
    return max(ATTACHMENT_TIME + round(t * NANOSECONDS), 0)


class McapFile:
    """MCAP file as a source of tables, one per topic; a truncated file gives its whole chunks."""

    def __init__(self, path: Path) -> None:
        """Read messages in JSON and protobuf from the file at `path`, and its attachments."""
        self.path = path
        self.name = path.stem
        self._rows: dict[str, list[Row]] = {}
        self.documents: Mapping[str, bytes] = {}
        self._read(read_bytes(path, LARGEST_FILE))

    def table(self, topic: str, _how: object) -> pa.Table:
        """Messages of `topic` as rows with their `log_time` [s]; ConfigurationError without any.

        Nested fields are joined by dots; a list of objects gives a row for each entry.
        """
        if topic not in self._rows:
            known = sorted(self._rows)
            raise ConfigurationError(
                f"{self.path}: topic {topic!r} is not there{suggestion(topic, known)}; "
                f"topics: {', '.join(known)}"
            )
        rows = self._rows[topic]
        names = dict.fromkeys(name for row in rows for name in row)
        return pa.table({name: pa.array([row.get(name) for row in rows]) for name in names})

    def _read(self, content: bytes) -> None:
        from mcap.exceptions import EndOfFile, McapError
        from mcap.records import Attachment, Channel, Message, Schema
        from mcap.stream_reader import StreamReader
        from zstandard import ZstdError

        schemas: dict[int, Schema] = {}
        channels: dict[int, Channel] = {}
        try:
            for record in StreamReader(BytesIO(content), record_size_limit=LARGEST_FILE).records:
                if isinstance(record, Schema):
                    schemas[record.id] = record
                elif isinstance(record, Channel):
                    channels[record.id] = record
                elif isinstance(record, Attachment):
                    self.documents = {**self.documents, record.name: record.data}
                elif isinstance(record, Message):
                    channel = channels[record.channel_id]
                    message = decode_message(record.data, channel, schemas.get(channel.schema_id))
                    rows = self._rows.setdefault(channel.topic, [])
                    rows += [{**row, "log_time": 1e-9 * record.log_time} for row in flat(message)]
        except (EndOfFile, struct.error):  # its writer was killed
            return
        except (McapError, ZstdError, KeyError, ValueError, RuntimeError) as error:
            raise ConfigurationError(
                f"{self.path}: is not an MCAP file that can be read: {error}"
            ) from None


def decode_message(data: bytes, channel: "Channel", schema: "Schema | None") -> Row:
    """Decode a message of JSON or protobuf to plain values; empty for any other encoding."""
    if channel.message_encoding == "json":
        message = json.loads(data)
        return message if isinstance(message, dict) else {}
    if channel.message_encoding != "protobuf" or schema is None or _is_picture(schema):
        return {}
    from google.protobuf.json_format import MessageToDict
    from mcap_protobuf.decoder import DecoderFactory

    decode = DecoderFactory().decoder_for(channel.message_encoding, schema)
    return {} if decode is None else MessageToDict(decode(data), preserving_proto_field_name=True)


def _is_picture(schema: "Schema") -> bool:
    return schema.name.rpartition(".")[2] in {"CompressedImage", "RawImage", "CompressedVideo"}


def flat(message: Row) -> list[Row]:
    """Rows of scalars of a message: nested names joined by dots, a row for each listed object."""
    plain_parts: Row = {}
    several: list[Row] = []
    for name, value in message.items():
        if isinstance(value, dict):
            plain_parts |= {f"{name}.{key}": v for row in flat(value) for key, v in row.items()}
        elif isinstance(value, list):
            several += [{"i": i, **item} for i, item in enumerate(value) if isinstance(item, dict)]
        else:
            plain_parts[name] = value
    return [{**plain_parts, **row} for row in several] or [plain_parts]
