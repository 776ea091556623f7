"""Columns of foreign tables, in SI units and the cell frame."""

import io
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
import pyarrow as pa
import pyarrow.csv as pc

from cell.record.exchange.mapping import COUNTS, FACTORS, LENGTHS, MAPPING, MEASURES, Column, Table
from cell.record.parquet_file import read_parquet
from drivers.errors import ConfigurationError, suggestion
from drivers.files import MEGABYTE, read_bytes
from drivers.types import Array, frozen

LARGEST_TABLE = 64 * MEGABYTE
FILE = re.compile(r"[^/\\]+\.(csv|txt|tsv|parquet)")


class Source(Protocol):
    """Where the tables of one run come from: a folder, a file, an episode."""

    @property
    def path(self) -> Path:
        """The file or folder, for errors."""

    @property
    def name(self) -> str:
        """What to call the run."""

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
        """Name of the folder."""
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
    """`columns` of the file of `table` in `source`, each (n,) in SI units by its name with us.

    Raises ConfigurationError for a file, a column or a unit that cannot be used.
    """
    content = source.table(table.file, table)
    path = source.path / table.file if isinstance(source, Folder) else source.path
    found = {name: _values(content, column, name, path) for name, column in columns}
    if "t" in found and table.late:
        found["t"] = frozen(found["t"] - table.late)
    return found


def _csv(path: Path, table: Table) -> pa.Table:
    parse = pc.ParseOptions(delimiter=table.delimiter)
    convert = pc.ConvertOptions(decimal_point=table.decimal, null_values=["", "nan", "NaN", "NA"])
    try:
        return pc.read_csv(
            io.BytesIO(read_bytes(path, LARGEST_TABLE)),
            parse_options=parse,
            convert_options=convert,
        )
    except (pa.ArrowException, ValueError) as error:
        reason = (str(error).splitlines() or ["no reason given"])[0]
        raise ConfigurationError(
            f"{path}: cannot be read as CSV with {table.delimiter!r} between columns: {reason}"
        ) from None


def _values(content: pa.Table, column: Column, name: str, path: Path) -> Array:
    known = MEASURES.get(name, LENGTHS)
    if name not in COUNTS and column.unit not in known:
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
    if not (pa.types.is_floating(raw.type) or pa.types.is_integer(raw.type)):
        raise ConfigurationError(
            f"{path}: column {column.column!r} for {name} holds {raw.type}, must hold numbers; "
            "state `decimal` and `delimiter` of the file in the mapping"
        )
    numbers = raw.cast(pa.float64(), safe=False).to_numpy()
    factor = 1.0 if name in COUNTS else FACTORS[column.unit]
    sign = -1.0 if column.reversed else 1.0
    return frozen(sign * (np.asarray(numbers, dtype=np.float64) * factor - column.offset))
