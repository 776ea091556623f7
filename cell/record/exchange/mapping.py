"""The mapping file of `cell import`, and foreign tables read by it in SI units and the cell frame.

It names the foreign column for each quantity, with its unit.
"""

import io
import json
import re
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Generic, Literal, TypeVar

import numpy as np
import pyarrow as pa
import pyarrow.csv as pc
from pydantic import Field, field_validator

from cell.record.header import Sigma
from drivers.errors import ConfigurationError, suggestion
from drivers.readers import MEGABYTE, read_bytes, read_parquet, read_text
from drivers.settings import Metres, Seconds, Settings
from drivers.types import Array, Frame, frozen

LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}
TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
ANGLES = {"rad": 1.0, "deg": 0.017453292519943295}
FORCES = {"N": 1.0, "mN": 1e-3, "cN": 1e-2}
FACTORS = LENGTHS | TIMES | ANGLES | FORCES
MEASURES = {
    "t": TIMES, "contact_t": TIMES, "t_layer_touch": TIMES, "pitch": ANGLES,
    "f_x": FORCES, "f_z": FORCES,
}  # fmt: skip
"""Units by column; all other columns are lengths."""
COUNTS = frozenset({"i"})  # have no unit
MAPPING = "mapping.yaml"  # as `cell export` names it

Name = TypeVar("Name", bound=str)
Delimiter = Annotated[str, Field(min_length=1, max_length=1)]
TickColumn = Literal["t", "x", "z", "pitch", "x_cmd", "z_cmd", "contact_x", "contact_t",
                     "f_x", "f_z"]  # fmt: skip
ResultColumn = Literal["t_layer_touch", "l1", "l2", "displacement"]
LARGEST_TABLE = 64 * MEGABYTE
# null: every cell is empty
NUMBER_TYPES = (pa.types.is_floating, pa.types.is_integer, pa.types.is_null)
COMMENT = re.compile(r"^[ \t]*(?:#|%|//).*\n?", re.MULTILINE)
SEPARATOR = re.compile(r"sep=(.)\r?\n")  # a spreadsheet's first line
ISO = " or times as 2026-01-31T12:00:00.250"
FILE = re.compile(r"[^/\\]+\.(csv|txt|tsv|parquet)")


class Column(Settings):
    """A foreign column: name, unit, `offset` [SI] of its zero; if `reversed`, the sign changes."""

    column: str = Field(min_length=1)
    unit: str
    offset: float = 0.0
    reversed: bool = False


class Table(Settings, Generic[Name]):
    """Place of a table: a file in the run's folder, a topic of an MCAP file, or `episode`.

    Files are CSV or Parquet, `episode` is that of a LeRobot data set. `late` [s] is the delay of
    the table's stamps.
    """

    file: str = Field(min_length=1)
    delimiter: Delimiter = ","
    decimal: Literal[".", ","] = "."
    late: Seconds = Field(0.0, ge=-10.0, le=10.0)
    columns: dict[Name, Column]


class Place(Settings):
    """Order of a run in its series, `index`, and the `condition` that its repeats share."""

    index: int | None = Field(None, ge=0, le=1_000_000)
    condition: str | None = None


class MappingFile(Settings):
    """Contents of a mapping file; quantities left out were not measured.

    `sigma` are the one-sigma errors [m], [s], [N] of what was measured; `runs` are facts of single
    runs by the name of their folder, without which their order is that of the call;
    `begin` is their clock at our t = 0, without it that of the first row of `ticks`; `result` has
    one row, and no file where no touch was seen;
    `seen_by` says that this cell's perception saw the strip, whose errors are known.
    """

    schema_: Literal[1] = Field(1, alias="schema")
    strip: str = Field(min_length=1)
    start: Literal["flat", "hanging"] = "flat"
    condition: str | None = None
    begin: Seconds | None = None
    contact_height: Metres = Field(0.001, gt=0, le=0.05)
    seen_by: Literal["cell"] | None = None
    runs: dict[str, Place] = Field(default_factory=dict)
    sigma: Sigma
    ticks: Table[TickColumn]
    profile: Table[Literal["t", "i", "x", "z"]] | None = None
    contact: Table[Literal["t", "contact_x"]] | None = None
    result: Table[ResultColumn] | None = None

    @field_validator("ticks")
    @classmethod
    def _needed(cls, ticks: Table[TickColumn]) -> Table[TickColumn]:
        missing = [name for name in ("t", "x", "z") if name not in ticks.columns]
        if missing:
            raise ValueError(f"columns: {missing[0]} is missing; add it")
        return ticks


@dataclass(frozen=True, slots=True)
class Source:
    """Source of one run's tables: its file or folder, the run's name, and YAML files by name.

    `table` returns the table that a mapping names; it raises ConfigurationError without one.
    `images` yields the images of a film, with the row of `ticks` at which each was taken.
    """

    path: Path
    name: str
    documents: Mapping[str, bytes]
    table: Callable[[str, Table[Any]], pa.Table]
    images: Callable[[], Iterable[tuple[int, Frame]]] = tuple


def folder_source(folder: Path) -> Source:
    """Source of CSV and Parquet files in `folder`; for others it raises ConfigurationError."""

    def table(file: str, how: Table[Any]) -> pa.Table:
        if FILE.fullmatch(file) is None:
            raise ConfigurationError(
                f"mapping: file: {file!r} is not the name of a file in each run's folder that ends "
                "in .csv, .txt, .tsv or .parquet"
            )
        path = folder / file
        return read_parquet(path) if path.suffix == ".parquet" else _csv(path, how)

    place = folder.resolve()
    beside = place.parent / MAPPING
    documents = {MAPPING: read_bytes(beside, MEGABYTE)} if beside.is_file() else {}
    return Source(folder, place.name, documents, table)


def read_columns(source: Source, table: Table[Any]) -> dict[str, Array]:
    """Read the columns of the `table` in `source`: arrays (n,) in SI units by the cell's names.

    Raises ConfigurationError for a file, a column or a unit that cannot be used.
    """
    content, path = source.table(table.file, table), path_of(source, table)
    found = {name: _values(content, column, name, path) for name, column in table.columns.items()}
    if "t" in found and table.late:
        found["t"] = frozen(found["t"] - table.late)
    return found


def path_of(source: Source, table: Table[Any]) -> Path:
    """Path of the file that holds `table`, for errors."""
    return source.path / table.file if source.path.is_dir() else source.path


def _csv(path: Path, table: Table[Any]) -> pa.Table:
    content = read_text(path, LARGEST_TABLE).removeprefix("\ufeff")
    stated = SEPARATOR.match(content)
    delimiter = stated[1] if stated else table.delimiter
    rows = COMMENT.sub("", content[stated.end() if stated else 0 :])
    head = rows.partition("\n")[0]
    other = next((mark for mark in ";\t|," if mark in head), delimiter)
    if delimiter not in head and other != delimiter:
        raise ConfigurationError(
            f"{path}: its first line has {other!r} between columns, not {delimiter!r}; state "
            f"delimiter: {json.dumps(other)} in the mapping, and its decimal"
        )
    if all(map(_is_number, head.replace(table.decimal, ".").split(delimiter))):
        names = content.partition(head)[0].rpartition("\n")[0].rpartition("\n")[2]
        rows = f"{names.lstrip('#%/ ')}\n{rows}" if COMMENT.match(names) else rows
    parse = pc.ParseOptions(delimiter=delimiter)
    convert = pc.ConvertOptions(decimal_point=table.decimal, null_values=["", "nan", "NaN", "NA"])
    try:
        return pc.read_csv(
            io.BytesIO(f"{rows}\n".encode()), parse_options=parse, convert_options=convert
        )
    except (pa.ArrowException, ValueError) as error:
        reason = (str(error).splitlines() or ["no reason given"])[0]
        raise ConfigurationError(
            f"{path}: cannot be read as CSV with {delimiter!r} between columns: {reason}"
        ) from None


def _is_number(value: object) -> bool:
    try:
        float(str(value))
    except ValueError:
        return False
    return True


def _values(content: pa.Table, column: Column, name: str, path: Path) -> Array:
    """Values (n,) of a foreign column in SI units and axes of the cell frame.

    Raises ConfigurationError for an unknown unit, a missing column, or one that holds no numbers.
    """
    known = MEASURES.get(name, LENGTHS)
    if column.unit not in known and name not in COUNTS:
        raise ConfigurationError(
            f"mapping: {name}: unit {column.unit!r} is not known{suggestion(column.unit, known)}; "
            f"allowed: {', '.join(known)}"
        )
    names = content.column_names
    if names.count(column.column) != 1:
        there = "stands there twice" if column.column in names else "is not there"
        raise ConfigurationError(
            f"{path}: column {column.column!r} for {name} {there}"
            f"{suggestion(column.column, names)}; columns: {', '.join(names)}"
        )
    raw = content[column.column]
    if known is TIMES and (seconds := _seconds(raw)) is not None:
        return seconds
    if not any(holds(raw.type) for holds in NUMBER_TYPES):
        words = ((row, word) for row, word in enumerate(raw.to_pylist(), 1) if not _is_number(word))
        where = next((f" ({word!r} in row {row})" for row, word in words), "")
        raise ConfigurationError(
            f"{path}: column {column.column!r} for {name} holds {raw.type}{where}, must hold "
            f"numbers{ISO if known is TIMES else ''}; state the file's `decimal` in "
            "the mapping, or leave the row out"
        )
    numbers = raw.cast(pa.float64(), safe=False).to_numpy()
    sign = -1.0 if column.reversed else 1.0
    return frozen(
        sign
        * (np.asarray(numbers, dtype=np.float64) * FACTORS.get(column.unit, 1.0) - column.offset)
    )


def _seconds(raw: pa.ChunkedArray) -> Array | None:
    """Seconds (n,) since 1970 of a column of times by ISO 8601, with their zone or all without."""
    if not (pa.types.is_string(raw.type) or pa.types.is_timestamp(raw.type)):
        return None
    for kind in (pa.timestamp("ns"), pa.timestamp("ns", "UTC")):
        with suppress(pa.ArrowException):
            return frozen(raw.cast(kind).cast(pa.int64()).to_numpy() / 1e9)
    return None
