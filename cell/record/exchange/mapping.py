"""The mapping file of `cell import`, and foreign tables read by it in SI units and the cell frame.

It names the foreign column for each quantity, with its unit.
"""

import io
import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, Protocol

import numpy as np
import pyarrow as pa
import pyarrow.csv as pc
from pydantic import Field

from cell.record.header import Sigma
from drivers.errors import ConfigurationError, suggestion
from drivers.readers import MEGABYTE, read_bytes, read_parquet, read_text
from drivers.settings import Metres, Seconds, Settings
from drivers.types import Array, frozen

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

Delimiter = Annotated[str, Field(min_length=1, max_length=1)]
TickColumn = Literal["t", "x", "z", "pitch", "x_cmd", "z_cmd", "contact_x", "contact_t",
                     "f_x", "f_z"]  # fmt: skip
ResultColumn = Literal["t_layer_touch", "l1", "l2", "displacement"]
LARGEST_TABLE = 64 * MEGABYTE
# null: every cell is empty
NUMBER_TYPES = (pa.types.is_floating, pa.types.is_integer, pa.types.is_null)
FILE = re.compile(r"[^/\\]+\.(csv|txt|tsv|parquet)")


class Column(Settings):
    """A foreign column: name, unit, `offset` [SI] of its zero; if `reversed`, the sign changes."""

    column: str = Field(min_length=1)
    unit: str
    offset: float = 0.0
    reversed: bool = False


class Table(Settings):
    """Place of a table: a file in the run's folder, a topic of an MCAP file, or `episode`.

    Files are CSV or Parquet, `episode` is that of a LeRobot data set. `late` [s] is the delay of
    the table's stamps.
    """

    file: str = Field(min_length=1)
    delimiter: Delimiter = ","
    decimal: Literal[".", ","] = "."
    late: Seconds = Field(0.0, ge=-10.0, le=10.0)


class TickTable(Table):
    """Table of the gripper's motion, one row per tick; at least `t`, `x`, `z`."""

    columns: dict[TickColumn, Column]


class ProfileTable(Table):
    """Table of points of the strip's midline, one per row; `t` is equal within an image."""

    columns: dict[Literal["t", "i", "x", "z"], Column]


class ContactTable(Table):
    """Table of the strip's contact with the desk, one row per image."""

    columns: dict[Literal["t", "contact_x"], Column]


class ResultTable(Table):
    """Table with the touch of the layers in one row; absent where none was seen."""

    columns: dict[ResultColumn, Column]


class Place(Settings):
    """Order of a run in its series, `index`, and the `condition` that its repeats share."""

    index: int | None = Field(None, ge=0, le=1_000_000)
    condition: str | None = None


class MappingFile(Settings):
    """Contents of a mapping file; quantities left out were not measured.

    `sigma` are the one-sigma errors [m], [s], [N] of what was measured; `runs` are facts of single
    runs by the name of their folder, without which their order is that of the call;
    `begin` is their clock at our t = 0, without it that of the first row of `ticks`;
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
    ticks: TickTable
    profile: ProfileTable | None = None
    contact: ContactTable | None = None
    result: ResultTable | None = None


class Source(Protocol):
    """Protocol of a source of one run's tables: a folder, a file, an episode."""

    @property
    def path(self) -> Path:
        """The source's file or folder, for errors."""

    @property
    def name(self) -> str:
        """Name for the imported run."""

    @property
    def documents(self) -> Mapping[str, bytes]:
        """YAML documents that came with the tables, by file name."""

    def table(self, file: str, how: Table) -> pa.Table:
        """The table that the mapping names `file`; ConfigurationError where there is none."""


@dataclass(frozen=True, slots=True)
class Folder:
    """A folder with the tables of a run as CSV or Parquet files."""

    path: Path

    @property
    def name(self) -> str:
        """Name of the folder, as the run's name."""
        return self.path.resolve().name

    @property
    def documents(self) -> Mapping[str, bytes]:
        """Content of the mapping file that `cell export` writes beside the folder, if there."""
        path = self.path.resolve().parent / MAPPING
        return {MAPPING: read_bytes(path, MEGABYTE)} if path.is_file() else {}

    def table(self, file: str, how: Table) -> pa.Table:
        """The table in `file`; ConfigurationError for one that cannot be read."""
        if FILE.fullmatch(file) is None:
            raise ConfigurationError(
                f"mapping: file: {file!r} is not the name of a file in each run's folder that ends "
                "in .csv, .txt, .tsv or .parquet"
            )
        path = self.path / file
        return read_parquet(path) if path.suffix == ".parquet" else _csv(path, how)


def read_columns(
    source: Source, table: Table, columns: Iterable[tuple[str, Column]]
) -> dict[str, Array]:
    """Read `columns` of the `table` in `source`: arrays (n,) in SI units by the cell's names.

    Raises ConfigurationError for a file, a column or a unit that cannot be used.
    """
    content, path = source.table(table.file, table), path_of(source, table)
    found = {name: _values(content, column, name, path) for name, column in columns}
    if "t" in found and table.late:
        found["t"] = frozen(found["t"] - table.late)
    return found


def path_of(source: Source, table: Table) -> Path:
    """Path of the file that holds `table`, for errors."""
    return source.path / table.file if isinstance(source, Folder) else source.path


def _csv(path: Path, table: Table) -> pa.Table:
    content = read_text(path, LARGEST_TABLE)
    head = content.partition("\n")[0]
    other = next((mark for mark in ";\t|," if mark in head), table.delimiter)
    if table.delimiter not in head and other != table.delimiter:
        raise ConfigurationError(
            f"{path}: its first line has {other!r} between columns, not {table.delimiter!r}; state "
            f"delimiter: {json.dumps(other)} in the mapping, and its decimal"
        )
    parse = pc.ParseOptions(delimiter=table.delimiter)
    convert = pc.ConvertOptions(decimal_point=table.decimal, null_values=["", "nan", "NaN", "NA"])
    try:
        return pc.read_csv(
            io.BytesIO(f"{content}\n".encode()), parse_options=parse, convert_options=convert
        )
    except (pa.ArrowException, ValueError) as error:
        reason = (str(error).splitlines() or ["no reason given"])[0]
        raise ConfigurationError(
            f"{path}: cannot be read as CSV with {table.delimiter!r} between columns: {reason}"
        ) from None


def _is_number(value: object) -> bool:
    try:
        float(str(value))
    except ValueError:
        return False
    return True


def _unit_factor(column: Column, name: str) -> float:
    """Factor from the column's unit to SI; ConfigurationError for a unit that `name` lacks."""
    if name in COUNTS:
        return 1.0
    known = MEASURES.get(name, LENGTHS)
    if column.unit not in known:
        raise ConfigurationError(
            f"mapping: {name}: unit {column.unit!r} is not known{suggestion(column.unit, known)}; "
            f"allowed: {', '.join(known)}"
        )
    return FACTORS[column.unit]


def _values(content: pa.Table, column: Column, name: str, path: Path) -> Array:
    """Values (n,) of a foreign column in SI units and axes of the cell frame.

    Raises ConfigurationError for an unknown unit, a missing column, or one that holds no numbers.
    """
    factor = _unit_factor(column, name)
    names = content.column_names
    if names.count(column.column) != 1:
        there = "stands there twice" if column.column in names else "is not there"
        raise ConfigurationError(
            f"{path}: column {column.column!r} for {name} {there}"
            f"{suggestion(column.column, names)}; columns: {', '.join(names)}"
        )
    raw = content[column.column]
    if not any(holds(raw.type) for holds in NUMBER_TYPES):
        words = ((row, word) for row, word in enumerate(raw.to_pylist(), 1) if not _is_number(word))
        where = next((f" ({word!r} in row {row})" for row, word in words), "")
        raise ConfigurationError(
            f"{path}: column {column.column!r} for {name} holds {raw.type}{where}, must hold "
            "numbers; state the file's `decimal` in the mapping, or leave the row out"
        )
    numbers = raw.cast(pa.float64(), safe=False).to_numpy()
    sign = -1.0 if column.reversed else 1.0
    return frozen(sign * (np.asarray(numbers, dtype=np.float64) * factor - column.offset))
