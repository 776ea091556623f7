"""Arrow IPC streams, one row per message: rows written before a crash can be read after it.

A `Tick` is a row of the stream of ticks.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import pyarrow as pa

from drivers.errors import ConfigurationError
from drivers.files import new_file, write_all
from drivers.readers import MEGABYTE, read_bytes
from drivers.types import ArmState

END_OF_STREAM = b"\xff\xff\xff\xff\x00\x00\x00\x00"
LARGEST_STREAM = 128 * MEGABYTE  # a fold of two minutes writes ten
LATER_COLUMNS = frozenset({"cost"})  # which records from before lack
NUMBER = pa.float64()
POINTS_TYPE = pa.list_(pa.float64())

TICK_ROWS = pa.schema(
    [(name, NUMBER) for name in ("t", "x", "z", "pitch", "x_cmd", "z_cmd", "f_x", "f_z")]
    + [("image_age", NUMBER), ("cost", NUMBER), ("state", pa.string())]
)
SIGHT_ROWS = pa.schema(
    [("stamp", NUMBER), ("sequence", pa.int64())]
    + [(name, NUMBER) for name in ("contact_x", "contact_confidence", "profile_confidence")]
    + [(name, NUMBER) for name in ("tip_x", "tip_z", "gap", "gap_x")]
    + [("profile_x", POINTS_TYPE), ("profile_z", POINTS_TYPE)]
)
NOT_MEASURED = float("nan")


class StreamFile:
    """Arrow stream being written; `append` returns once the operating system has the row.

    Raises OSError when the disk refuses.
    """

    def __init__(self, path: Path, schema: pa.Schema) -> None:
        self._row = pa.struct(list(schema))
        self._file = new_file(path)
        self._write(schema.serialize())

    def append(self, row: Mapping[str, Any]) -> None:
        """Append one row, a value for each column."""
        rows = pa.array([row], self._row)
        self._write(pa.RecordBatch.from_struct_array(rows).serialize())

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
    """Read all complete rows of the stream at `path`, with the columns of `schema`.

    Empty without a file, or with one truncated inside its header. Raises ConfigurationError for a
    stream with other columns.
    """
    batches: list[Any] = []
    content = read_bytes(path, LARGEST_STREAM) if path.exists() else b""
    try:
        with pa.ipc.open_stream(pa.py_buffer(content)) as reader:
            found = reader.schema
            if content:
                _check_columns(path, found, schema)
            batches.extend(_complete_batches(reader))
    except (pa.ArrowException, OSError):
        return pa.Table.from_batches([], schema)
    return pa.Table.from_batches(batches, found).combine_chunks()


def _check_columns(path: Path, found: pa.Schema, wanted: pa.Schema) -> None:
    try:
        names = found.names
    except UnicodeDecodeError:
        raise ConfigurationError(
            f"{path}: the names of its columns are no text; it was changed after the run"
        ) from None
    for field in wanted:
        if field.name not in LATER_COLUMNS and (
            names.count(field.name) != 1 or found.field(field.name).type != field.type
        ):
            raise ConfigurationError(
                f"{path}: {field.name}: the column is missing or not {field.type}; "
                "it was changed after the run"
            )


def _complete_batches(reader: Any) -> Iterator[Any]:
    while True:
        try:
            batch = reader.read_next_batch()
            batch.validate(full=True)
        except (StopIteration, pa.ArrowException, OSError):
            return
        yield batch


@dataclass(frozen=True, slots=True)
class Tick:
    """Row of ticks.parquet: pose, command, force and state of the cell in one control cycle.

    Measured `x`, `z` [m] and `pitch` [rad] at `t` [s], commanded `x_cmd`, `z_cmd` [m], force `f_x`,
    `f_z` [N] on the gripper, and `cost`, the computing time [s]; NaN where not measured.
    """

    t: float
    x: float
    z: float
    pitch: float
    x_cmd: float
    z_cmd: float
    state: str
    f_x: float = NOT_MEASURED
    f_z: float = NOT_MEASURED
    cost: float = NOT_MEASURED

    @classmethod
    def from_state(cls, arm: ArmState, state: str, cost: float = NOT_MEASURED) -> Self:
        """The row of a measured arm state; `t` is the moment of the joint reading."""
        pose, commanded = arm.pose, arm.commanded
        measured = arm.stamp, pose.x, pose.z, pose.pitch
        return cls(*measured, commanded.x, commanded.z, state, *arm.force, cost)
