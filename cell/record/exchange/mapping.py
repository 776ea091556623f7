"""Mapping file of `cell import`, and foreign tables read by it in SI units.

It names the foreign column for each quantity, with its unit; an exported run brings its
own.
"""

import csv
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from itertools import takewhile
from pathlib import Path
from typing import Annotated, Any, Generic, Literal, TypeVar

import pyarrow as pa
from pyarrow.csv import ConvertOptions, ParseOptions, ReadOptions, read_csv
from pydantic import BeforeValidator, Field, field_validator

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
from cell.record.tables import (
    EMPTY,
    check_width,
    column_named,
    numbers_of,
    seconds_of,
    turn_of,
    unit_in_cells,
    unnest,
    with_named_parts,
)
from drivers.base.errors import ConfigurationError, suggestion
from drivers.base.readers import MEGABYTE, read_bytes, read_parquet, read_text
from drivers.base.settings import Metres, Seconds, Settings, VersionedFile
from drivers.base.types import Array, Frame, frozen
from drivers.base.yaml_text import dump_yaml

PER_SECOND = {f"{unit}/s": factor for unit, factor in (LENGTHS | ANGLES).items()}
TORQUES = {f"{unit} m": factor for unit, factor in FORCES.items()}
FACTORS = LENGTHS | TIMES | ANGLES | FORCES | COUNTS | PER_SECOND | TORQUES
UNITS = {unit.lower(): unit for unit in FACTORS}
UNITS |= {"sec": "s", "seconds": "s", "秒": "s", "°": "deg", "grad": "deg", "度": "deg"}
"""Units by the words that columns and cells use for them."""
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
TickColumn = Literal["t", "x", "z", "pitch", "x_cmd", "z_cmd", "pitch_cmd", "hand_cmd",
                     "contact_x", "contact_t", "f_x", "f_z"]  # fmt: skip
ResultColumn = Literal["t_layer_touch", "l1", "l2", "displacement"]
LARGEST_TABLE = 64 * MEGABYTE
COMMENT = re.compile(r"\s*(?:#(?![A-Z/0]+[!,;\t|])|%|//)")  # but not #N/A
MARKS = ";\t|,"  # between columns, of equally many the likeliest first
DECIMAL_COMMA = re.compile(
    r"(?m)(?:^|(?<=[;\t|])) *-?\d+,\d+(?:[eE][-+]?\d+)? *(?=$|[;\t|\r])"
)
NUMBER = re.compile(r" *[-+]?(?:[.,]?\d|inf)")  # how a number or a time begins
# a number, and no mark between two
PLAIN = re.compile(r"(?:[-+]?(?:\d+(?:[.,]\d*)?|\.\d+)(?:[eE][-+]?\d+)?|[-+]?inf|nan)?")
# rows of which a heading is at most; of later rows that are read to find its end; below
# a row of numbers in which words show that it belongs to the heading
LONGEST_HEADING, SAMPLE, FOLLOWING = 100, 200, 4
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


class RunFacts(Settings):
    """Order `index` of a run in its series, and the `condition` that its repeats
    share.
    """

    index: int | None = Field(None, ge=0, le=1_000_000)
    condition: str | None = None


class MotionFacts(RunFacts):
    """Facts on a mechanism's run: order, condition, `load`; `origin` is its whole
    recording.
    """

    origin: str | None = None
    load: Load | None = None


def _listed(value: object) -> object:
    return tuple(value) if isinstance(value, list) else (value,)


class SignalMapping(VersionedFile):
    """Contents of a mapping file of a mechanism: the column of each of its signals and
    inputs.

    `signals` is a table, or a list of tables with a clock each: readings of the later
    ones are placed at the times of the first.
    """

    mechanism: str = Field(min_length=1)
    condition: str | None = None
    runs: dict[str, MotionFacts] = Field(default_factory=dict)
    signals: Annotated[
        tuple[Table[str], ...], BeforeValidator(_listed), Field(min_length=1)
    ]

    @field_validator("signals")
    @classmethod
    def _timed(cls, tables: tuple[Table[str], ...]) -> tuple[Table[str], ...]:
        names = [name for table in tables for name in {*table.columns} - {"t"}]
        if len(tables) > 1 and not all("t" in table.columns for table in tables):
            raise ValueError(
                "columns: t is missing; each of several tables has its own"
            )
        if twice := next((name for name in names if names.count(name) > 1), ""):
            raise ValueError(f"columns: {twice} stands in two tables; keep one")
        return tables

    @property
    def tables(self) -> dict[str, Table[Any]]:
        """The first table of a mechanism's signals, under the name of the file of a run
        into which it is imported.
        """
        return {SIGNALS: self.signals[0]}


class MappingFile(VersionedFile):
    """Contents of a mapping file; quantities left out were not measured.

    `sigma` are the one-sigma errors [m], [s], [N] of what was measured; `runs` are
    facts of single runs by the name of their folder, without which their order is that
    of the call;
    `begin` is their clock at our t = 0, without it that of the first row of `ticks`;
    `result` has one row, and no file where no touch was seen;
    `seen_by` says that this cell's perception saw the strip, whose errors are known.
    """

    strip: str = Field(min_length=1)
    start: Literal["flat", "hanging"] = "flat"
    condition: str | None = None
    begin: Seconds | None = None
    contact_height: Metres = Field(0.001, gt=0, le=0.05)
    seen_by: Literal["cell"] | None = None
    runs: dict[str, RunFacts] = Field(default_factory=dict)
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
        """Tables of a fold by the name of the run's file that each is imported to."""
        stated = {TICKS: self.ticks, PROFILE: self.profile, RESULT: self.result}
        return {file: table for file, table in stated.items() if table is not None}


@dataclass
class Source(ABC):
    """Run of another program that can be imported: its tables by name, perhaps camera
    images, and perhaps YAML documents.
    """

    path: Path
    name: str
    documents: Mapping[str, bytes]
    names: Sequence[str]  # of the tables
    # on what was passed over
    remarks: list[str] = field(default_factory=list, kw_only=True)

    @abstractmethod
    def table(self, how: Table[Any]) -> pa.Table:
        """Table that the mapping entry `how` names; ConfigurationError if broken."""

    def missing(self, how: Table[Any]) -> ConfigurationError:
        """Error for a mapping whose entry `how` names a table that is not there."""
        return ConfigurationError(
            f"{self.path}: the mapping reads {how.file}, which is not there"
            f"{suggestion(how.file, self.names)}; tables: {', '.join(self.names)}"
        )

    def place(self, how: Table[Any]) -> Path:  # noqa: ARG002
        """Path, in messages of errors, of the file that mapping entry `how` names."""
        return self.path

    def images(self) -> Iterable[tuple[int, Frame]]:
        """Images of the run, each with the number of the row of motion at which it was
        taken; none where it has no film.
        """
        return ()


def stored_mapping(path: Path) -> dict[str, bytes]:
    """Mapping file at `path`, as its name and content; empty where there is none."""
    return {MAPPING: read_bytes(path, MEGABYTE)} if path.is_file() else {}


class TableFiles(Source):
    """Run of another program in CSV and Parquet files, of a folder or a single one."""

    def __init__(self, path: Path) -> None:
        """Find the tables of a run in the folder at `path` or, where `path` is a file,
        take that alone.
        """
        resolved, alone = path.resolve(), path.is_file()
        self._files = [path] if alone else sorted(path.iterdir())
        found = [file.name for file in self._files if FILE.fullmatch(file.name)]
        super().__init__(
            path,
            resolved.stem if alone else resolved.name,
            stored_mapping(resolved.parent / MAPPING),
            [f"*{path.suffix}"] if alone else found,  # of all such files
        )

    def table(self, how: Table[Any]) -> pa.Table:
        """Table from the one CSV or Parquet file that the mapping entry `how` names.

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
            unnest(read_parquet(found), str(found))
            if found.suffix == ".parquet"
            else _csv(found, how)
        )

    def place(self, how: Table[Any]) -> Path:
        """Path of the file that the entry `how` of a mapping names; ConfigurationError
        where its pattern fits several files.
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
    """Columns (n,) that the mapping entry `table` names in `source`, in SI units.

    Raises ConfigurationError for a file, a column or a unit that cannot be used;
    `measures` are the units by column.
    """
    content, path = source.table(table), source.place(table)
    wanted = [column.column for column in table.columns.values()]
    rows = content.num_rows
    content = with_named_parts(content, wanted, str(path))
    if passed := rows - content.num_rows:
        source.remarks.append(
            f"{source.path}: {table.file}: {passed} of {rows} rows hold other parts,"
            " and are passed over"
        )
    found = {
        name: _values(content, column, name, units_of(name, measures), path)
        for name, column in table.columns.items()
    }
    if "t" in found and table.late:
        found["t"] = frozen(found["t"] - table.late)
    return found


def _csv(path: Path, table: Table[Any]) -> pa.Table:
    """Table in the CSV file at `path`, read as the entry `table` of a mapping states,
    without comments and blank lines.

    Rows of words above the numbers, each with a cell a column, name the columns; where
    there are none a comment does, else their numbers from 0.
    """
    # or as of Windows
    content = read_text(path, LARGEST_TABLE, "cp1252").removeprefix("\ufeff")
    if "\0" in content:
        raise ConfigurationError(f"{path}: is not UTF-8 text; save it as CSV in UTF-8")
    lines = [line for line in content.splitlines() if line.strip()]
    rows = [line for line in lines if not COMMENT.match(line)]
    rows, delimiter, decimal = _split(rows, table)
    options = ParseOptions(delimiter=delimiter)
    convert = ConvertOptions(decimal_point=decimal, null_values=list(EMPTY))
    try:
        names, begin = _header(rows, delimiter)
        if not any(names):
            names = _names_in_comments(lines, delimiter, len(names))
        check_width(len(names), str(path))
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
    """Names of the columns of a CSV file, made of all words above them, and how many of
    its rows come before the numbers.

    What later rows have in common tells the columns of numbers. The heading ends before
    the first row with numbers alone in these, where no row of words follows at once.
    Rows of other lengths are what an instrument writes above its table.
    """
    later = rows[len(rows) // 2 :: 1 + len(rows) // SAMPLE]
    sample = [_cells(row, delimiter) for row in later]
    width = max(map(len, sample), default=0)
    whole = [row for row in sample if len(row) == width]
    numeric = [i for i in range(width) if all(_is_value(row[i]) for row in whole)]

    heading: list[list[str]] = []
    begin = len(rows)
    kinds = [_kind(row, delimiter, width, numeric) for row in rows[:LONGEST_HEADING]]
    for number, kind in enumerate(kinds):
        if kind == "numbers" and "words" not in kinds[number : number + FOLLOWING]:
            begin = number
            break
        if kind != "other":
            cells = _cells(rows[number], delimiter)
            heading.append(["" if cell in EMPTY else cell for cell in cells])
    return _joined(heading, width), begin


def _kind(row: str, delimiter: str, width: int, numeric: Sequence[int]) -> str:
    """Whether the cells of a CSV row, in the columns `numeric`, hold `numbers`,
    `words`, `both` or `neither`; `other` where the row has not `width` cells.
    """
    cells = _cells(row, delimiter)
    if len(cells) != width:
        return "other"
    told = [cells[i] for i in numeric if cells[i] not in EMPTY]
    numbers = sum(map(_is_value, told))
    if numbers == len(told):
        return "numbers" if told else "neither"
    return "both" if numbers else "words"


def _joined(heading: Sequence[Sequence[str]], width: int) -> list[str]:
    """Names of `width` columns, each made of the words that the rows of a `heading`
    have above it.

    Where all rows but the last begin with empty cells, their first words name them.
    """
    columns = [list(column) for column in zip(*heading, strict=True)]
    labelled = [i for i, (*above, _) in enumerate(columns) if any(above)]
    first = min(labelled, default=0)
    if len(heading) > 2 and first > 0:
        labels = list(filter(None, columns[first]))
        if len({*labels}) == len(labels) > 2:
            columns[first][:-1] = []
    words = [" ".join(" ".join(column).split()) for column in columns]
    return words or [""] * width


def _names_in_comments(lines: Sequence[str], delimiter: str, width: int) -> list[str]:
    """Names of `width` columns from the last comment above a CSV table that has as many
    words, or else their numbers from 0.
    """
    notes = [note.strip().lstrip("#%/ ") for note in takewhile(COMMENT.match, lines)]
    for note in reversed(notes):
        for cells in (_cells(note, delimiter), _cells(note, ","), note.split()):
            if len(cells) == width:
                return [cell.strip() for cell in cells]
    return list(map(str, range(width)))


def _is_value(cell: str) -> bool:
    return cell in EMPTY or NUMBER.match(cell) is not None


def _cells(row: str, delimiter: str) -> list[str]:
    return next(csv.reader([row], delimiter=delimiter), [])


def _split(rows: list[str], table: Table[Any]) -> tuple[list[str], str, str]:
    """CSV `rows` with one delimiter between cells, this delimiter and the decimal mark.

    They are guessed where `table` states none. A cell with a decimal comma counts as no
    delimiter, unless it is the whole row in the middle. Any number of blanks is one.
    """
    row = rows[len(rows) // 2].strip() if rows else ""
    without_decimals = DECIMAL_COMMA.sub("", row).strip(" ") or row
    found = table.delimiter or max(MARKS, key=without_decimals.count)

    no_mark = found not in row or all(map(PLAIN.fullmatch, row.split(" ")))
    by_blanks = table.delimiter is None and " " in row and no_mark
    if found == " " or by_blanks:
        rows = ["\t".join(row.split()) for row in rows]
        found = "\t"

    has_commas = found != "," and any(map(DECIMAL_COMMA.search, rows))
    return rows, found, table.decimal or ("," if has_commas else ".")


def _is_number(text: str) -> bool:
    """Whether the text can be read as a number by `float`."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def units_of(
    column: str, measures: Mapping[str, Mapping[str, float]] = MEASURES
) -> Mapping[str, float]:
    """Units that the cell's `column` may have with their factors to SI, SI first."""
    return measures.get(column, measures[""])


def _values(
    content: pa.Table, column: Column, name: str, known: Mapping[str, float], path: Path
) -> Array:
    """Values (n,) of a foreign column in SI units, along the axes of the cell.

    Raises ConfigurationError for a unit that is not `known`, a missing column, or one
    that holds no numbers.
    """
    unit = column.unit
    if unit not in known and known is not COUNTS:
        raise ConfigurationError(
            f"mapping: {name}: unit {unit!r} is not"
            f" known{suggestion(unit, known)}; allowed: {', '.join(known)}"
        )
    if unit == "quaternion" and known is PITCH:
        parts = (
            Column(column=column.column.replace("*", axis), unit="1") for axis in "xyzw"
        )
        numbers = turn_of(
            *(_values(content, part, name, COUNTS, path) for part in parts)
        )
    else:
        origin = f"{path}: column {column.column!r} for {name}"
        raw = column_named(content, column.column, origin)
        if known is TIMES and (seconds := seconds_of(raw)) is not None:
            return seconds
        numbers = _numbers(raw, origin, known)
        _check_unit(raw, column, origin)
    factor = known.get(unit, 1.0) * column.factor
    sign = -1.0 if column.reversed else 1.0
    return frozen(sign * (numbers * factor - column.offset))


def _check_unit(raw: pa.ChunkedArray, column: Column, origin: str) -> None:
    """Raise ConfigurationError where cells state another unit than the mapping."""
    told = unit_in_cells(raw) or ""
    stated = column.unit
    unit = UNITS.get(told.lower(), stated)
    if unit != stated:
        raise ConfigurationError(
            f"{origin}: its cells are in {told}, the mapping states {stated};"
            f" write unit: {unit}"
        )


def _numbers(raw: pa.ChunkedArray, origin: str, known: Mapping[str, float]) -> Array:
    """Numbers (n,) of a foreign column; ConfigurationError where it holds others."""
    if (numbers := numbers_of(raw)) is not None:
        return numbers
    where = next(
        (
            f" ({str(cell)!r} in row {row})"
            for row, cell in enumerate(raw.to_pylist(), 1)
            if not (cell in {None, *EMPTY} or _is_number(str(cell)))
        ),
        "",
    )
    raise ConfigurationError(
        f"{origin} holds {raw.type}{where}, must hold numbers{ISO * (known is TIMES)};"
        " state the file's `decimal` in the mapping, write 1234.5 for 1,234.5, or"
        " leave the row out"
    )


def documents_of(run: Run) -> dict[str, bytes]:
    """YAML documents of `run` that are exported, by file name; empty if missing."""
    files = (run.folder / name for name in (RUN, RESULT, CALIBRATION))
    return {
        file.name: read_bytes(file, MEGABYTE) if file.is_file() else b""
        for file in files
    }


def mapping_of(
    runs: Sequence[Run], name: Naming, tables: Sequence[str] = TABLES
) -> bytes:
    """Content of the mapping file by which exported `runs` can be imported again;
    `name` gives file and column in the format of the export.

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
