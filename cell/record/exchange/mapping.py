"""The mapping file of `cell import`, and foreign tables read by it in SI units and the
cell frame.

It names the foreign column for each quantity, with its unit; an exported run brings its
own.
"""

import csv
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from fnmatch import fnmatchcase
from itertools import takewhile
from pathlib import Path
from typing import Annotated, Any, Generic, Literal, TypeVar

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from pyarrow.csv import ConvertOptions, ParseOptions, ReadOptions, read_csv
from pydantic import Field, field_validator

from cell.record.columns import (
    ANGLES,
    COUNTS,
    FORCES,
    LENGTHS,
    TIMES,
    Profile,
    Ticks,
    quantities,
)
from cell.record.documents import plain
from cell.record.files import CALIBRATION, PROFILE, RESULT, RUN, SIGNALS, TICKS
from cell.record.header import Load, Sigma
from cell.record.run import Run
from cell.record.tables import unnest
from drivers.base.errors import ConfigurationError, suggestion
from drivers.base.readers import MEGABYTE, read_bytes, read_parquet, read_text
from drivers.base.settings import Metres, Seconds, Settings
from drivers.base.types import Array, Frame, frozen
from drivers.base.yaml_text import dump_yaml

PER_SECOND = {f"{unit}/s": factor for unit, factor in (LENGTHS | ANGLES).items()}
TORQUES = {f"{unit} m": factor for unit, factor in FORCES.items()}
FACTORS = LENGTHS | TIMES | ANGLES | FORCES | COUNTS | PER_SECOND | TORQUES
MEASURES = {
    name: q.units for table in (Ticks, Profile) for name, q in quantities(table).items()
}
PITCH = {**MEASURES["pitch"], "quaternion": 1.0}
MEASURES |= {"t_layer_touch": TIMES, "": LENGTHS, "pitch": PITCH}
"""Units [SI, the first of them] by column; "" stands for all other columns."""
OF_SIGNALS = {"t": TIMES, "": FACTORS}
MAPPING = "mapping.yaml"  # as `cell export` names it
TABLES = ("ticks", "contact", "profile", "result")  # of a run, as a mapping names them

Name = TypeVar("Name", bound=str)
Naming = Callable[[str, str], tuple[str, str]]
"""Function from a table and its column to the file and column that hold it in a format.
"""
Delimiter = Annotated[str, Field(min_length=1, max_length=1)]
TickColumn = Literal["t", "x", "z", "pitch", "x_cmd", "z_cmd", "contact_x", "contact_t",
                     "f_x", "f_z"]  # fmt: skip
ResultColumn = Literal["t_layer_touch", "l1", "l2", "displacement"]
LARGEST_TABLE = 64 * MEGABYTE
COMMENT = re.compile(r"\s*(?:#(?![A-Z/0]+[!,;\t|])|%|//)")  # but not #N/A
MARKS = ";\t|,"  # between columns, of equally many the likeliest first
DECIMAL_COMMA = re.compile(
    r"(?m)(?:^|(?<=[;\t|])) *-?\d+,\d+(?:[eE][-+]?\d+)? *(?=$|[;\t|\r])"
)
EMPTY = {*ConvertOptions().null_values, "None", "#NV", "#DIV/0!", "#VALUE!"}  # no value
NUMBER = re.compile(r" *[-+]?[.,]?\d")  # how a number or a time begins
# 31.01.2026 12:00:00,250 as ISO 8601
AS_ISO = ((r"^(\d\d)[.](\d\d)[.](\d{4})\b", r"\3-\2-\1"), (r"(:\d\d),(\d+)", r"\1.\2"))
ISO = " or times as 2026-01-31T12:00:00.250"
FILE = re.compile(r"[^/\\]+\.(csv|txt|tsv|parquet)")


class Column(Settings):
    """A foreign column: name, unit, `offset` [SI] of its zero; if `reversed`, the sign
    changes.

    `factor` is how many of the unit one of the column is. In a `column` of the unit
    `quaternion` a `*` stands for x, y, z and w; it gives the turn from x to z since the
    first row.
    """

    column: str = Field(min_length=1)
    unit: str
    factor: float = Field(1.0, gt=0)
    offset: float = 0.0
    reversed: bool = False


class Table(Settings, Generic[Name]):
    """Place of a table: a file of the run, a topic of an MCAP file, or `episode`.

    Files are CSV or Parquet, one whose name varies by a pattern (`*.csv`); `episode` is
    that of a LeRobot data set. What separates columns and decimals in a CSV need not be
    stated. `late` [s] is the delay of the table's stamps.
    """

    file: str = Field(min_length=1)
    delimiter: Delimiter | None = None
    decimal: Literal[".", ","] | None = None
    late: Seconds = Field(0.0, ge=-10.0, le=10.0)
    columns: dict[Name, Column]


class Place(Settings):
    """Order `index` of a run in its series, and the `condition` that its repeats
    share.
    """

    index: int | None = Field(None, ge=0, le=1_000_000)
    condition: str | None = None


class PlaceOfMotion(Place):
    """Facts on a mechanism's run: order, condition, `load`; `origin` is its whole
    recording.
    """

    origin: str | None = None
    load: Load | None = None


class SignalMapping(Settings):
    """Contents of a mapping file of a mechanism: the column of each of its signals and
    inputs.
    """

    schema_: Literal[1] = Field(1, alias="schema")
    mechanism: str = Field(min_length=1)
    condition: str | None = None
    runs: dict[str, PlaceOfMotion] = Field(default_factory=dict)
    signals: Table[str]

    @property
    def tables(self) -> dict[str, Table[Any]]:
        """Foreign table of a mechanism's signals, by the run's file that it is imported
        to.
        """
        return {SIGNALS: self.signals}


class MappingFile(Settings):
    """Contents of a mapping file; quantities left out were not measured.

    `sigma` are the one-sigma errors [m], [s], [N] of what was measured; `runs` are
    facts of single runs by the name of their folder, without which their order is that
    of the call;
    `begin` is their clock at our t = 0, without it that of the first row of `ticks`;
    `result` has one row, and no file where no touch was seen;
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

    @property
    def tables(self) -> dict[str, Table[Any]]:
        """Foreign tables of a fold, by the run's file that each is imported to."""
        stated = {TICKS: self.ticks, PROFILE: self.profile, RESULT: self.result}
        return {file: table for file, table in stated.items() if table is not None}


class Source(ABC):
    """One run in a foreign format: its tables by name, and maybe images and YAML
    documents.
    """

    path: Path
    name: str
    documents: Mapping[str, bytes]
    names: Sequence[str]  # of the tables

    @abstractmethod
    def table(self, how: Table[Any]) -> pa.Table:
        """Foreign table that `how` names; ConfigurationError where it cannot be
        read.
        """

    def missing(self, how: Table[Any]) -> ConfigurationError:
        """Error of a mapping that names a table, `how`, which the source does not
        hold.
        """
        return ConfigurationError(
            f"{self.path}: the mapping reads {how.file}, which is not there"
            f"{suggestion(how.file, self.names)}; tables: {', '.join(self.names)}"
        )

    def place(self, how: Table[Any]) -> Path:  # noqa: ARG002
        """Path of the file that holds the table `how`, for errors."""
        return self.path

    def images(self) -> Iterable[tuple[int, Frame]]:
        """Images of the run's film, if any, each with the row of `ticks` at which it
        was taken.
        """
        return ()


class TableFiles(Source):
    """A run in CSV and Parquet files: those of a folder, or one alone."""

    def __init__(self, path: Path) -> None:
        """Find the tables in the folder at `path`, or take the single file at
        `path`.
        """
        place = path.resolve()
        mapping = place.parent / MAPPING
        self.path, self.name = path, place.stem if path.is_file() else place.name
        self.documents = (
            {MAPPING: read_bytes(mapping, MEGABYTE)} if mapping.is_file() else {}
        )
        self._files = [path] if path.is_file() else sorted(path.iterdir())
        found = [file.name for file in self._files if FILE.fullmatch(file.name)]
        # of all such files
        self.names = [f"*{path.suffix}"] if path.is_file() else found

    def table(self, how: Table[Any]) -> pa.Table:
        """Read the one CSV or Parquet file that `how` names, perhaps by a pattern.

        Raises ConfigurationError for another name, or a file that cannot be read.
        """
        if FILE.fullmatch(how.file) is None:
            raise ConfigurationError(
                f"mapping: file: {how.file!r} is not the name of a file of each run"
                " that ends in .csv, .txt, .tsv or .parquet"
            )
        found = self.place(how)
        if not found.exists():
            raise self.missing(how)
        return (
            unnest(read_parquet(found))
            if found.suffix == ".parquet"
            else _csv(found, how)
        )

    def place(self, how: Table[Any]) -> Path:
        """Path of the file that `how` names; ConfigurationError where several have its
        name.
        """
        found = [file for file in self._files if fnmatchcase(file.name, how.file)]
        if len(found) > 1:
            raise ConfigurationError(
                f"{self.path}: {how.file} are {len(found)} files; where each is a run,"
                " give the files"
            )
        return found[0] if found else self.path / how.file


def read_columns(
    source: Source,
    table: Table[Any],
    measures: Mapping[str, Mapping[str, float]] = MEASURES,
) -> dict[str, Array]:
    """Read the columns of the `table` in `source`: arrays (n,) in SI units by the
    cell's names.

    Raises ConfigurationError for a file, a column or a unit that cannot be used;
    `measures` are the units by column.
    """
    content, path = source.table(table), source.place(table)
    found = {
        name: _values(content, column, name, units_of(name, measures), path)
        for name, column in table.columns.items()
    }
    if "t" in found and table.late:
        found["t"] = frozen(found["t"] - table.late)
    return found


def _csv(path: Path, table: Table[Any]) -> pa.Table:
    """Read the CSV file at `path` as `table` states, without its comments and blank
    lines.

    Rows of words above the numbers, each with a cell a column, name the columns; where
    there are none the last comment does.
    """
    # or as of Windows
    content = read_text(path, LARGEST_TABLE, "cp1252").removeprefix("\ufeff")
    if "\0" in content:
        raise ConfigurationError(f"{path}: is not UTF-8 text; save it as CSV in UTF-8")
    lines = [line for line in content.splitlines() if line.strip()]
    rows = [line for line in lines if not COMMENT.match(line)]
    delimiter, decimal = _guess_marks(rows, table)
    options = ParseOptions(delimiter=delimiter)
    convert = ConvertOptions(decimal_point=decimal, null_values=list(EMPTY))
    try:
        names, begin = _header(rows, delimiter)
        if not any(names):
            notes = ["", *takewhile(COMMENT.match, lines)]
            names = _cells(notes[-1].strip().lstrip("#%/ "), delimiter)
        if begin == len(rows):
            return pa.table([pa.nulls(0)] * len(names), names)
        # no BytesIO: a thread that still holds it aborts an interpreter that ends
        text = pa.BufferReader("\n".join((*rows[begin:], "")).encode())
        return read_csv(text, ReadOptions(column_names=names), options, convert)
    except (pa.ArrowException, ValueError, csv.Error) as error:
        reason = (str(error).splitlines() or ["no reason given"])[0]
        raise ConfigurationError(
            f"{path}: cannot be read as CSV with {delimiter!r} between columns:"
            f" {reason}"
        ) from None


def _header(rows: Sequence[str], delimiter: str) -> tuple[list[str], int]:
    """Names of the columns, by all words above them, and how many rows come before the
    numbers.
    """
    names = [""] * len(_cells(rows[len(rows) // 2], delimiter)) if rows else []
    for begin, row in enumerate(rows):
        words = ["" if cell in EMPTY else cell for cell in _cells(row, delimiter)]
        numbers, whole = (
            [*map(NUMBER.match, filter(None, words))],
            len(words) == len(names),
        )
        if any(numbers) and (any(names) or (whole and all(numbers))):
            return names, begin
        if whole:  # else it is what an instrument writes above its table
            names = [
                " ".join(filter(None, pair)) for pair in zip(names, words, strict=True)
            ]
    return names, len(rows)


def _cells(row: str, delimiter: str) -> list[str]:
    return next(csv.reader([row], delimiter=delimiter), [])


def _guess_marks(rows: Sequence[str], table: Table[Any]) -> tuple[str, str]:
    """Delimiter and decimal mark of CSV `rows`, guessed where `table` states none.

    A cell with a decimal comma counts as no delimiter, unless it is the whole row in
    the middle.
    """
    row = rows[len(rows) // 2] if rows else ""
    found = table.delimiter or max(
        MARKS, key=(DECIMAL_COMMA.sub("", row).strip(" ") or row).count
    )
    has_commas = found != "," and any(map(DECIMAL_COMMA.search, rows))
    return found, table.decimal or ("," if has_commas else ".")


def _is_number(text: str) -> bool:
    """Whether `float` can read `text` as a number."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def units_of(
    column: str, measures: Mapping[str, Mapping[str, float]] = MEASURES
) -> Mapping[str, float]:
    """Units of the cell's `column`, the SI unit first, each with its factor to it."""
    return measures.get(column, measures[""])


def _values(
    content: pa.Table, column: Column, name: str, known: Mapping[str, float], path: Path
) -> Array:
    """Values (n,) of a foreign column in SI units and axes of the cell frame.

    Raises ConfigurationError for a unit that is not `known`, a missing column, or one
    that holds no numbers.
    """
    if column.unit not in known and known is not COUNTS:
        raise ConfigurationError(
            f"mapping: {name}: unit {column.unit!r} is not"
            f" known{suggestion(column.unit, known)}; allowed: {', '.join(known)}"
        )
    if column.unit == "quaternion" and known is PITCH:
        parts = (
            Column(column=column.column.replace("*", axis), unit="1") for axis in "xyzw"
        )
        numbers = turn_of(
            *(_values(content, part, name, COUNTS, path) for part in parts)
        )
    else:
        origin = f"{path}: column {column.column!r} for {name}"
        raw = _column_named(content, column.column, origin)
        if known is TIMES and (seconds := seconds_of(raw)) is not None:
            return seconds
        numbers = _numbers(raw, origin, known)
    factor = known.get(column.unit, 1.0) * column.factor
    sign = -1.0 if column.reversed else 1.0
    return frozen(sign * (numbers * factor - column.offset))


def turn_of(x: Array, y: Array, z: Array, w: Array) -> Array:
    """Turn (n,) [rad] from x to z, about -y, of quaternions with parts (n,) since the
    first.
    """
    along = w * w[:1] + x * x[:1] + y * y[:1] + z * z[:1]
    across = w * y[:1] - y * w[:1] + z * x[:1] - x * z[:1]
    return np.asarray(2 * np.unwrap(np.arctan2(across, along), period=np.pi))


def _numbers(raw: pa.ChunkedArray, origin: str, known: Mapping[str, float]) -> Array:
    """Numbers (n,) of a column; ConfigurationError, with its `origin`, where it holds
    others.
    """
    if (numbers := numbers_of(raw)) is not None:
        return numbers
    cells = (
        (row, str(v))
        for row, v in enumerate(raw.to_pylist(), 1)
        if v not in (None, *EMPTY)
    )
    where = next(
        (f" ({v!r} in row {row})" for row, v in cells if not _is_number(v)), ""
    )
    raise ConfigurationError(
        f"{origin} holds {raw.type}{where}, must hold numbers{ISO * (known is TIMES)};"
        " state the file's `decimal` in the mapping, write 1234.5 for 1,234.5, or"
        " leave the row out"
    )


def _column_named(content: pa.Table, name: str, origin: str) -> pa.ChunkedArray:
    """The one column called `name`; ConfigurationError, with its `origin`, for none or
    two.
    """
    names = content.column_names
    if names.count(name) != 1:
        there = "stands there twice" if name in names else "is not there"
        raise ConfigurationError(
            f"{origin} {there}{suggestion(name, names)}; columns: {', '.join(names)}"
        )
    return content[name]


def numbers_of(raw: pa.ChunkedArray) -> Array | None:
    """Numbers (n,) of a column, NaN where it is empty; None for a column of another
    type.
    """
    kind = raw.type  # null where every cell is empty
    if not (
        pa.types.is_floating(kind)
        or pa.types.is_integer(kind)
        or pa.types.is_null(kind)
    ):
        return None
    return np.asarray(raw.cast(pa.float64(), safe=False).to_numpy(), dtype=np.float64)


def seconds_of(raw: pa.ChunkedArray) -> Array | None:
    """Seconds (n,) since 1970 of a column of ISO 8601 times, all with a zone or all
    without.
    """
    if not (pa.types.is_string(raw.type) or pa.types.is_timestamp(raw.type)):
        return None
    for pattern, iso in AS_ISO if pa.types.is_string(raw.type) else ():
        raw = pc.replace_substring_regex(raw, pattern, iso)
    for kind in (pa.timestamp("ns"), pa.timestamp("ns", "UTC")):
        with suppress(pa.ArrowException):
            return frozen(raw.cast(kind).cast(pa.int64()).to_numpy() / 1e9)
    return None


def documents_of(run: Run) -> dict[str, bytes]:
    """YAML documents of a run that an export includes, by file name; empty if
    missing.
    """
    files = (run.folder / name for name in (RUN, RESULT, CALIBRATION))
    return {
        file.name: read_bytes(file, MEGABYTE) if file.is_file() else b""
        for file in files
    }


def mapping_of(
    runs: Sequence[Run], name: Naming, tables: Sequence[str] = TABLES
) -> bytes:
    """Text of the mapping file of exported runs; `name` gives the format's file and
    column.

    A table or column is described where every run has it, the touch where any has.
    """
    header = runs[0].header
    content: dict[str, Any] = {
        "schema": 1,
        "strip": header.strip,
        "start": header.start,
        "begin": 0.0,
        "contact_height": header.contact_height,
        "sigma": header.sigma.model_dump(exclude_unset=True),
        "runs": {
            run.name: (
                {"index": i}
                | run.header.model_dump(
                    include={"index", "condition"}, exclude_none=True
                )
            )
            for i, run in enumerate(runs)
        },
    }
    if all(run.header.by_cell for run in runs):
        content["seen_by"] = "cell"
    for table in tables:
        present = [run.tables()[table] for run in runs if table in run.tables()]
        if present and (table == "result" or len(present) == len(runs)):
            shared = [
                column
                for column in present[0]
                if all(column in each for each in present)
            ]
            file, _ = name(table, shared[0])
            columns = {
                c: {"column": name(table, c)[1], "unit": next(iter(units_of(c)))}
                for c in shared
            }
            content[table] = {"file": file, "columns": columns}
    return dump_yaml(plain(content)).encode()
