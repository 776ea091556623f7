"""List of the runs in a folder, read from their files: filter, order and deletion."""

import os
import re
import shutil
import sqlite3
from collections.abc import Collection, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import fields
from datetime import UTC, datetime, timedelta
from itertools import islice
from math import isfinite
from pathlib import Path
from typing import Annotated, Any

from pydantic import AliasPath, Field, PlainValidator, TypeAdapter
from pydantic.dataclasses import dataclass

from cell.record.files import NOTES, RESULT, RUN, is_run, is_under_way, runs_below
from cell.record.header import Result, read_result
from drivers.base.errors import ConfigurationError, check_known
from drivers.base.files import encoded, lock_folders
from drivers.base.readers import read_text
from drivers.base.yaml_text import parse_yaml

BEGAN = re.compile(r"(\d{8}T\d{6}Z)-")
UNDER_WAY, DIED, BROKEN, MEASURED = "under way", "died", "broken", "measured"
HEADER_KEYS = frozenset(
    {"strip", "policy", "seed", "speed", "start", "condition", "drivers", "calibration"}
)
LARGEST_INTEGER = 2**63 - 1  # of SQLite


def _number(value: object) -> float | None:
    if (
        isinstance(value, bool)
        or not isinstance(value, int | float)
        or not isfinite(value)
    ):
        return None
    return float(value)


def _text(value: object) -> str:
    if value is None or isinstance(value, bool | list | dict):
        return ""
    return f"{value:g}" if isinstance(value, float) else str(value)


Number = Annotated[float | None, PlainValidator(_number)]
Text = Annotated[str, PlainValidator(_text)]
Whole = Annotated[int | None, PlainValidator(lambda v: v if type(v) is int else None)]
YesOrNo = Annotated[
    bool | None, PlainValidator(lambda v: v if isinstance(v, bool) else None)
]


def _of(document: str, *keys: str) -> Any:
    """Field of a row in the list of runs, read from a run's `document`, such as its
    header, at the nested `keys`; None where it is not stated.
    """
    return Field(
        None, validation_alias=AliasPath(document, *keys), validate_default=True
    )


@dataclass(frozen=True, kw_only=True)
class RunRow:
    """Row of a list of runs: lengths [m], times [s], `speed` [m/s]; None where unknown.

    `outcome` is that recorded, or `under way`, `died`, `broken`, or `measured` of a
    mechanism; `size` is that on disk [bytes]; `tags` are separated by spaces. `touch`
    is the time of the layer touch, `predicted` the displacement that the policy
    expected.
    """

    folder: Path
    began: datetime
    strip: Text = _of("header", "strip")
    policy: Text = _of("header", "policy")
    outcome: str
    displacement: Number = _of("result", "displacement")
    edge_offset: Number = _of("result", "edge_offset")
    duration: Number = _of("result", "duration")
    size: int
    touch: Number = _of("result", "t_layer_touch")
    predicted: Number = _of("result", "foretold", "displacement")
    like_model: YesOrNo = _of("result", "agreement", "like_model")
    reason: Text = _of("result", "reason")
    seed: Whole = _of("header", "seed")
    speed: Number = _of("header", "speed")
    start: Annotated[str, PlainValidator(lambda v: _text(v) or "flat")] = _of(
        "header", "start"
    )
    condition: Text = _of("header", "condition")
    arm: Text = _of("header", "drivers", "arm")
    camera: Text = _of("header", "drivers", "camera")
    calibration: Text = _of("header", "calibration", "id")
    tags: Text = _of("notes", "tags")
    note: Text = _of("notes", "note")

    @property
    def name(self) -> str:
        """Name of the run's folder, in which bytes that are no UTF-8 are escaped."""
        return encoded(self.folder.name).decode()

    @property
    def short(self) -> str:
        """Short name of the run for tables: the last four characters of its name and
        when it began, or the whole name if it has another form.
        """
        if BEGAN.match(self.name) is None:
            return self.name
        return f"{self.name[-4:]}  {self.began:%Y-%m-%d %H:%M}"

    @property
    def offsets(self) -> tuple[str, ...]:
        """Displacement, and offset of the laid edges, as texts in millimetres; each is
        empty where it is not known.
        """
        lengths = (self.displacement, self.edge_offset)
        return tuple(
            "" if length is None else f"{1e3 * length:+.1f}" for length in lengths
        )

    def __repr__(self) -> str:
        """Line of text with the run's name, strip, policy and outcome, and its
        displacement and offset of the edges where known.
        """
        displacement, edges = self.offsets
        lengths = (
            displacement and f"d {displacement} mm",
            edges and f"edges {edges} mm",
        )
        facts = filter(None, (self.strip, self.policy, self.outcome, *lengths))
        return f"<{self.short}: {', '.join(facts)}>"

    __str__ = __repr__


NAMES = tuple(field.name for field in fields(RunRow))
ROW = TypeAdapter(RunRow)
COLUMNS = ("run", *NAMES[1:])  # the folder by its name


def list_runs(root: Path, where: str = "", sort: str = "") -> tuple[RunRow, ...]:
    """Runs in the folder `root` and in its subfolders for which the SQL expression
    `where` holds, oldest first; all of them where that is empty.

    `sort` is the column to sort by instead, downwards with a leading `-`; runs without
    a value come last. Raises ConfigurationError for a `root` that is no folder or a run
    itself, and for what is no such expression or column.
    """
    if not root.is_dir():
        raise ConfigurationError(f"{root}: is not a folder; name one with --runs")
    if is_run(root):
        raise ConfigurationError(
            f"{root}: is a run; name the folder that it lies in with --runs, as "
            f"{root.resolve().parent}"
        )

    try:
        rows = [read_row(folder) for folder in runs_below(root)]
    except OSError as error:
        raise ConfigurationError(
            f"{root}: cannot be listed: {error.strerror}"
        ) from None

    rows.sort(key=lambda row: (row.began, row.name))
    return _select(rows, where, sort) if where or sort else tuple(rows)


def _select(rows: Sequence[RunRow], where: str, sort: str) -> tuple[RunRow, ...]:
    """Those of `rows` for which the SQL expression `where` holds, sorted by the column
    `sort`, or as they come where that is empty.
    """
    key = sort.removeprefix("-")
    order = "place"
    if key:
        check_known("sort", key, COLUMNS)
        direction = "DESC" if sort.startswith("-") else "ASC"
        order = f"{key} IS NULL, {key} {direction}, place"

    with closing(sqlite3.connect(":memory:")) as base:
        base.execute(f"CREATE TABLE runs (place, {', '.join(COLUMNS)})")
        marks = ", ".join("?" * (1 + len(COLUMNS)))
        base.executemany(
            f"INSERT INTO runs VALUES ({marks})",  # noqa: S608
            (
                (index, *map(_storable, values_of(row)))
                for index, row in enumerate(rows)
            ),
        )
        try:
            selected = base.execute(
                f"SELECT place FROM runs WHERE ({where or 1}\n) ORDER BY {order}"  # noqa: S608
            ).fetchall()
        except (sqlite3.Error, sqlite3.Warning, ValueError) as error:
            raise ConfigurationError(
                f"where: {error}; columns of runs: {', '.join(COLUMNS)}"
            ) from None
    return tuple(rows[index] for (index,) in selected if index in range(len(rows)))


def _storable(value: Any) -> Any:
    """The given `value`, or a float in place of a whole number that is too large for an
    SQLite database.
    """
    if isinstance(value, int) and abs(value) > LARGEST_INTEGER:
        return float(value)
    return value


def values_of(row: RunRow) -> tuple[Any, ...]:
    """Values of one run for all columns of the list of runs, in their order and in SI
    units.
    """
    later = (getattr(row, name) for name in NAMES[2:])
    return (row.name, row.began.isoformat(), *later)


def to_prune(
    rows: Sequence[RunRow],
    now: datetime,
    *,
    keep: int | None = None,
    older_than: timedelta | None = None,
) -> tuple[RunRow, ...]:
    """Runs that may be deleted, oldest first: all but the newest `keep`, or those that
    began longer than `older_than` before `now`.

    With both, a run must satisfy both. A run under way stays, and so does a link: what
    it leads to belongs elsewhere. Raises ConfigurationError when neither is given.
    """
    if keep is None and older_than is None:
        raise ConfigurationError("--keep, --older-than: give one")
    ordered = sorted(rows, key=lambda row: (row.began, row.name))
    surplus = ordered if keep is None else ordered[: max(len(ordered) - keep, 0)]
    old = [row for row in surplus if older_than is None or now - row.began > older_than]
    return tuple(r for r in old if r.outcome != UNDER_WAY and not r.folder.is_symlink())


def remove(rows: Sequence[RunRow]) -> int:
    """Delete the folders of the runs in `rows`, and return how many bytes that has
    freed.

    Raises ConfigurationError for a folder that is not a run, is one under way, or a
    link to one; and, once all others are gone, for those that changed since `rows` were
    read or could not be removed.
    """
    for folder in (row.folder for row in rows):
        if folder.is_symlink() or not is_run(folder) or is_under_way(folder):
            raise ConfigurationError(
                f"{folder}: is not a finished run; it was left alone"
            )

    failures = []
    for row in rows:
        folder = row.folder
        try:
            with lock_folders([folder]):
                if read_row(folder) == row:
                    shutil.rmtree(folder)
                else:
                    failures.append(
                        f"{folder}: has just been changed; it was left alone"
                    )
        except OSError as error:
            failures.append(f"{folder}: cannot be removed: {error.strerror}")
        except ConfigurationError as error:
            failures.append(str(error))

    if failures:
        raise ConfigurationError("\n".join(failures))
    return sum(row.size for row in rows)


def earlier_results(
    folder: Path, strip: str, policy: str | None, count: int
) -> list[Result]:
    """Results of up to `count` folds of `strip` by the same `policy` that lie beside
    the run in `folder` and came before it, the last one first.
    """
    begins = f"-{strip}-fold-"
    beside = sorted(run for run in folder.parent.iterdir() if begins in run.name)
    alike = (
        run
        for run in reversed(beside)
        if run.name < folder.name
        and (_document(run / RUN, {"policy"}) or {}).get("policy") == policy
    )
    results = []
    for run in islice(alike, count):
        with suppress(ConfigurationError, OSError):
            results.append(read_result(run))
    return [*filter(None, results)]


def read_row(folder: Path) -> RunRow:
    """Row for the list of runs on the run in `folder`, from its YAML files alone;
    values that cannot be read are empty.
    """
    header = _document(folder / RUN, HEADER_KEYS)
    result = _document(folder / RESULT)
    facts = {
        "folder": folder,
        "began": _start_time(folder),
        "size": _size(folder),
        "header": header,
        "result": result,
        "notes": _document(folder / NOTES),
        "outcome": _outcome(folder, header, result),
    }
    return ROW.validate_python(facts)


def _outcome(
    folder: Path, header: Mapping[str, Any] | None, result: Mapping[str, Any] | None
) -> str:
    """Outcome of a run for the list: the recorded one, or a word for a run that is
    under way, has died, is broken, or was only measured.
    """
    if header is None:
        return BROKEN
    if is_under_way(folder):
        return UNDER_WAY
    if result is not None:
        return _text(result.get("outcome")) or BROKEN
    if (folder / RESULT).exists():
        return BROKEN
    return DIED if "strip" in header else MEASURED


def _document(path: Path, keys: Collection[str] = ()) -> dict[str, Any] | None:
    """Content of the YAML file at `path`, with only the outermost `keys` if any are
    given; None where it cannot be read.

    With `keys` only those of the outermost level, where each begins a line: of a run's
    header that is a tenth, and the rest is what takes the time.
    """
    try:
        text = read_text(path)
        blocks = [
            b for b in re.split(r"(?m)^(?=\w)", text) if b.partition(":")[0] in keys
        ]
        return parse_yaml("".join(blocks) or text, str(path))
    except ConfigurationError:
        return None


def _size(folder: Path) -> int:
    """Size of all files below `folder` in bytes; files that are deleted meanwhile do
    not count.
    """
    total = 0
    for path, _, names in os.walk(folder):
        for name in names:
            with suppress(OSError):
                total += Path(path, name).stat().st_size
    return total


def _start_time(folder: Path) -> datetime:
    """Time at which the run in `folder` began, by the name of the folder, or else by
    the age of its header file, or else the start of 1970.
    """
    stamp = BEGAN.match(folder.name)
    with suppress(ValueError):
        if stamp is not None:
            return datetime.strptime(stamp[1], "%Y%m%dT%H%M%SZ").replace(tzinfo=UTC)
    with suppress(OSError, OverflowError, ValueError):
        return datetime.fromtimestamp((folder / RUN).stat().st_mtime, UTC)
    return datetime.fromtimestamp(0, UTC)
