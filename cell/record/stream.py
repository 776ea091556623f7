"""Arrow IPC streams, one row a message: what was written before a kill can be read after it."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Self

import pyarrow as pa

from cell.record.documents import write_all

END_OF_STREAM = b"\xff\xff\xff\xff\x00\x00\x00\x00"
NUMBER = pa.float64()
POINTS = pa.list_(pa.float64())

TICK_ROWS = pa.schema(
    [(name, NUMBER) for name in ("t", "x", "z", "pitch", "x_cmd", "z_cmd", "f_x", "f_z")]
    + [("image_age", NUMBER), ("cost", NUMBER), ("state", pa.string())]
)
SIGHT_ROWS = pa.schema(
    [("stamp", NUMBER), ("sequence", pa.int64())]
    + [(name, NUMBER) for name in ("contact_x", "contact_confidence", "profile_confidence")]
    + [(name, NUMBER) for name in ("tip_x", "tip_z", "gap", "gap_x")]
    + [("profile_x", POINTS), ("profile_z", POINTS)]
)


class StreamFile:
    """A stream being written; every row reaches the operating system before `append` returns.

    Raises OSError when the disk refuses.
    """

    def __init__(self, path: Path, schema: pa.Schema) -> None:
        self._schema = schema
        self._file = path.open("xb", buffering=0)
        self._write(schema.serialize())

    def append(self, row: Mapping[str, Any]) -> None:
        """Add one row, a value for each column."""
        columns = [pa.array([row[field.name]], field.type) for field in self._schema]
        self._write(pa.record_batch(columns, schema=self._schema).serialize())

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self.close()

    def close(self) -> None:
        """End the stream; allowed twice."""
        if not self._file.closed:
            try:
                self._write(END_OF_STREAM)
            finally:
                self._file.close()

    def _write(self, content: Any) -> None:
        write_all(self._file, memoryview(content))


def read_stream(path: Path, schema: pa.Schema) -> pa.Table:
    """Every whole row of a stream.

    Without a file, or with one that broke off inside its head, no rows of `schema`.
    """
    batches: list[Any] = []
    content = path.read_bytes() if path.exists() else b""
    try:
        with pa.ipc.open_stream(pa.py_buffer(content)) as reader:
            schema = reader.schema
            batches.extend(_whole(reader))
    except (pa.ArrowInvalid, OSError):
        return pa.Table.from_batches([], schema)
    return pa.Table.from_batches(batches, schema).combine_chunks()


def _whole(reader: Any) -> Iterator[Any]:
    while True:
        try:
            yield reader.read_next_batch()
        except (StopIteration, pa.ArrowInvalid, OSError):
            return
