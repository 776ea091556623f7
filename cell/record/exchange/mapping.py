"""The mapping file of `cell import`, and foreign tables read by it in SI units and the cell frame.

It names the foreign column for each quantity, with its unit.
"""

import io
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Annotated, Any, Generic, Literal, TypeVar

import numpy as np
import pyarrow as pa
import pyarrow.csv as pc
from pydantic import Field, field_validator

from cell.record.header import Load, Sigma
from drivers.errors import ConfigurationError, suggestion
from drivers.readers import MEGABYTE, read_bytes, read_parquet, read_text
from drivers.settings import Metres, Seconds, Settings
from drivers.types import Array, Frame, frozen

LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}
TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
ANGLES = {"rad": 1.0, "deg": 0.017453292519943295}
FORCES = {"N": 1.0, "mN": 1e-3, "cN": 1e-2}
COUNTS = {"1": 1.0}  # without a unit
PER_SECOND = {f"{unit}/s": factor for unit, factor in (LENGTHS | ANGLES).items()}
TORQUES = {f"{unit} m": factor for unit, factor in FORCES.items()}
FACTORS = LENGTHS | TIMES | ANGLES | FORCES | COUNTS | PER_SECOND | TORQUES
MEASURES = {
    "t": TIMES, "contact_t": TIMES, "t_layer_touch": TIMES, "pitch": ANGLES,
    "f_x": FORCES, "f_z": FORCES, "i": COUNTS, "": LENGTHS,
}  # fmt: skip
"""Units [SI, the first of them] by column; "" stands for all other columns."""
OF_SIGNALS = {"t": TIMES, "": FACTORS}
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
MARKS = ";\t|,"  # between columns, of equally many the likeliest first
DECIMAL_COMMA = re.compile(r"(?m)(?:^|[;\t|]) *-?\d+,\d+(?:[eE][-+]?\d+)? *(?:$|[;\t|\r])")
EMPTY = ("", "nan", "NaN", "NA")  # cells of a CSV without a value
ISO = " or times as 2026-01-31T12:00:00.250"
FILE = re.compile(r"[^/\\]+\.(csv|txt|tsv|parquet)")


class Column(Settings):
    """A foreign column: name, unit, `offset` [SI] of its zero; if `reversed`, the sign changes.

    `factor` is how many of the unit one of the column is.
    """

    column: str = Field(min_length=1)
    unit: str
    factor: float = Field(1.0, gt=0)
    offset: float = 0.0
    reversed: bool = False


class Table(Settings, Generic[Name]):
    """Place of a table: a file of the run, a topic of an MCAP file, or `episode`.

    Files are CSV or Parquet, one whose name varies by a pattern (`*.csv`); `episode` is that of a
    LeRobot data set. What separates columns and decimals in a CSV need not be stated. `late` [s] is
    the delay of the table's stamps.
    """

    file: str = Field(min_length=1)
    delimiter: Delimiter | None = None
    decimal: Literal[".", ","] | None = None
    late: Seconds = Field(0.0, ge=-10.0, le=10.0)
    columns: dict[Name, Column]


class Place(Settings):
    """Order of a run in its series, `index`, and the `condition` that its repeats share."""

    index: int | None = Field(None, ge=0, le=1_000_000)
    condition: str | None = None


class PlaceOfMotion(Place):
    """Place of a mechanism's run, with its `load` and the recording, `origin`, it was cut from."""

    origin: str | None = None
    load: Load | None = None


class SignalMapping(Settings):
    """Contents of a mapping file of a mechanism: the column of each of its signals and inputs."""

    schema_: Literal[1] = Field(1, alias="schema")
    mechanism: str = Field(min_length=1)
    condition: str | None = None
    runs: dict[str, PlaceOfMotion] = Field(default_factory=dict)
    signals: Table[str]


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
    """Where one run's foreign tables come from: path, name of the run, and YAML files by name.

    `names` are those of its tables; `table` returns the one that a mapping names, and raises
    ConfigurationError without one. `images` yields the images of a film, with the row of `ticks` at
    which each was taken.
    """

    path: Path
    name: str
    documents: Mapping[str, bytes]
    names: Sequence[str]
    table: Callable[[str, Table[Any]], pa.Table]
    images: Callable[[], Iterable[tuple[int, Frame]]] = tuple


def file_source(path: Path) -> Source:
    """Source of the tables in the folder at `path`, or of that file alone.

    It raises ConfigurationError for what is not CSV or Parquet.
    """

    def table(file: str, how: Table[Any]) -> pa.Table:
        if FILE.fullmatch(file) is None:
            raise ConfigurationError(
                f"mapping: file: {file!r} is not the name of a file of each run that ends in .csv, "
                ".txt, .tsv or .parquet"
            )
        found = _file(path, file)
        return read_parquet(found) if found.suffix == ".parquet" else _csv(found, how)

    place = path.resolve()
    beside = place.parent / MAPPING
    documents = {MAPPING: read_bytes(beside, MEGABYTE)} if beside.is_file() else {}
    if path.is_file():
        return Source(path, place.stem, documents, [f"*{path.suffix}"], table)
    names = [file.name for file in sorted(path.iterdir()) if FILE.fullmatch(file.name)]
    return Source(path, place.name, documents, names, table)


def _file(place: Path, name: str) -> Path:
    """The file of a run at `place` that has this `name`, which may be a pattern of one alone."""
    files = [place] if place.is_file() else sorted(place.iterdir())
    found = [file for file in files if fnmatchcase(file.name, name)]
    if len(found) > 1:
        raise ConfigurationError(
            f"{place}: {name} are {len(found)} files; where each is a run, give the files"
        )
    return found[0] if found else (place.parent if place.is_file() else place) / name


def read_columns(
    source: Source, table: Table[Any], measures: Mapping[str, Mapping[str, float]] = MEASURES
) -> dict[str, Array]:
    """Read the columns of the `table` in `source`: arrays (n,) in SI units by the cell's names.

    Raises ConfigurationError for a file, a column or a unit that cannot be used; `measures` are the
    units by column.
    """
    content, path = source.table(table.file, table), path_of(source, table)
    found = {
        name: _values(content, column, name, units_of(name, measures), path)
        for name, column in table.columns.items()
    }
    if "t" in found and table.late:
        found["t"] = frozen(found["t"] - table.late)
    return found


def path_of(source: Source, table: Table[Any]) -> Path:
    """Path of the file that holds `table`, for errors."""
    named = FILE.fullmatch(table.file) is not None
    return _file(source.path, table.file) if named else source.path


def _csv(path: Path, table: Table[Any]) -> pa.Table:
    content = read_text(path, LARGEST_TABLE).removeprefix("\ufeff")
    stated = SEPARATOR.match(content)
    rows = COMMENT.sub("", content[stated.end() if stated else 0 :])
    head = rows.partition("\n")[0]
    delimiter = stated[1] if stated else table.delimiter or max(MARKS, key=head.count)
    is_comma = delimiter != "," and DECIMAL_COMMA.search(rows) is not None
    decimal = table.decimal or ("," if is_comma else ".")
    if all(map(_is_number, head.replace(decimal, ".").split(delimiter))):
        names = content.partition(head)[0].rpartition("\n")[0].rpartition("\n")[2]
        rows = f"{names.lstrip('#%/ ')}\n{rows}" if COMMENT.match(names) else rows
    parse = pc.ParseOptions(delimiter=delimiter)
    convert = pc.ConvertOptions(decimal_point=decimal, null_values=list(EMPTY))
    try:
        return pc.read_csv(
            io.BytesIO(f"{rows}\n".encode()), parse_options=parse, convert_options=convert
        )
    except (pa.ArrowException, ValueError) as error:
        reason = (str(error).splitlines() or ["no reason given"])[0]
        raise ConfigurationError(
            f"{path}: cannot be read as CSV with {delimiter!r} between columns: {reason}"
        ) from None


def _is_number(text: str) -> bool:
    """Whether `text` is a number as `float` reads it."""
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

    Raises ConfigurationError for a unit that is not `known`, a missing column, or one that holds no
    numbers.
    """
    if column.unit not in known and known is not COUNTS:
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
    if known is TIMES and (seconds := seconds_of(raw)) is not None:
        return seconds
    if (numbers := numbers_of(raw)) is None:
        cells = enumerate(raw.to_pylist(), 1)
        words = ((row, str(v)) for row, v in cells if v not in (None, *EMPTY))
        where = next((f" ({v!r} in row {row})" for row, v in words if not _is_number(v)), "")
        raise ConfigurationError(
            f"{path}: column {column.column!r} for {name} holds {raw.type}{where}, must hold "
            f"numbers{ISO if known is TIMES else ''}; state the file's `decimal` in "
            "the mapping, or leave the row out"
        )
    factor = known.get(column.unit, 1.0) * column.factor
    sign = -1.0 if column.reversed else 1.0
    return frozen(sign * (numbers * factor - column.offset))


def numbers_of(raw: pa.ChunkedArray) -> Array | None:
    """Numbers (n,) of a column, NaN where it is empty; None for one of anything else."""
    if not any(holds(raw.type) for holds in NUMBER_TYPES):
        return None
    return np.asarray(raw.cast(pa.float64(), safe=False).to_numpy(), dtype=np.float64)


def seconds_of(raw: pa.ChunkedArray) -> Array | None:
    """Seconds (n,) since 1970 of a column of times by ISO 8601, with their zone or all without."""
    if not (pa.types.is_string(raw.type) or pa.types.is_timestamp(raw.type)):
        return None
    for kind in (pa.timestamp("ns"), pa.timestamp("ns", "UTC")):
        with suppress(pa.ArrowException):
            return frozen(raw.cast(kind).cast(pa.int64()).to_numpy() / 1e9)
    return None
