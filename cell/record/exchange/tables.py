"""Reading of columns of foreign tables, converted to SI units and the cell frame."""

import io
import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
import pyarrow as pa
import pyarrow.csv as pc

from cell.record.exchange.mapping import COUNTS, FACTORS, LENGTHS, MAPPING, MEASURES, Column, Table
from drivers.errors import ConfigurationError, suggestion
from drivers.readers import MEGABYTE, read_bytes, read_parquet, read_text
from drivers.types import Array, frozen

LARGEST_TABLE = 64 * MEGABYTE
# null: every cell is empty
NUMBER_TYPES = (pa.types.is_floating, pa.types.is_integer, pa.types.is_null)
FILE = re.compile(r"[^/\\]+\.(csv|txt|tsv|parquet)")


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
        """The mapping beside the folder, as `cell export` writes it."""
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
