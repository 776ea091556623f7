"""Index of the runs in a folder: an SQLite cache that is rebuilt from the run folders."""

import os
import sqlite3
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import astuple, fields
from datetime import datetime
from hashlib import sha256
from pathlib import Path
from typing import Any, Self

from cell.record.files import RESULT, RUN, is_run
from cell.record.listing import UNDER_WAY, RunRow, read_row
from drivers.errors import ConfigurationError, suggestion

SCHEMA_VERSION = 1  # of the columns; another one is thrown away
COLUMN_NAMES = tuple(field.name for field in fields(RunRow))
FOLDER_COLUMN = "run"  # in place of `folder`: the folder's name
RUN_COLUMNS = (FOLDER_COLUMN, *COLUMN_NAMES[1:])
LIKE_MODEL_PLACE = COLUMN_NAMES.index("like_model") - 2  # among the columns after name and start
ALLOWED_ACTIONS = {
    sqlite3.SQLITE_SELECT, sqlite3.SQLITE_READ, sqlite3.SQLITE_FUNCTION, sqlite3.SQLITE_RECURSIVE,
}  # fmt: skip
Stamp = tuple[int, int, int]  # times of change [ns] of the folder, run.yaml, result.yaml
Progress = Callable[[int, int], None]


class Catalogue:
    """Index of the runs directly under `root`, in a database in the folder `cache`.

    Where the cache cannot be written the index is made in memory, each time anew. Raises
    ConfigurationError when `root` is no folder, or a run itself.
    """

    def __init__(
        self, root: Path, cache: Path, progress: Progress = lambda _done, _total: None
    ) -> None:
        if not root.is_dir():
            raise ConfigurationError(f"{root}: is not a folder; name one with --runs")
        if is_run(root):
            raise ConfigurationError(
                f"{root}: is a run; name the folder that it lies in with --runs, as "
                f"{root.resolve().parent}"
            )
        self._root = root
        self._base = _open(cache / f"{sha256(os.fsencode(root.resolve())).hexdigest()[:16]}.sqlite")
        try:
            self._refresh(progress)
        except sqlite3.Error:  # another process holds it, or the disk is full
            self._base.close()
            self._base = _with_tables(sqlite3.connect(":memory:"))
            self._refresh(progress)
        self._base.set_authorizer(_read_only)

    def __enter__(self) -> Self:
        """Return this catalogue."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the database."""
        self._base.close()

    def rows(self, where: str = "", sort: str = "") -> tuple[RunRow, ...]:
        """Runs for which the SQL expression `where` holds, oldest first or by the column `sort`.

        A leading `-` sorts downwards; runs without a value come last. Raises ConfigurationError
        for what is no such expression or column.
        """
        key = sort.removeprefix("-")
        if key and key not in RUN_COLUMNS:
            raise ConfigurationError(
                f"--sort: unknown column {key!r}{suggestion(key, RUN_COLUMNS)}; "
                f"allowed: {', '.join(RUN_COLUMNS)}"
            )
        order = f"{key} IS NULL, {key} {'DESC' if sort.startswith('-') else 'ASC'}, " if key else ""
        text = f"SELECT {', '.join(RUN_COLUMNS)} FROM runs WHERE ({where or '1'}) "  # noqa: S608
        found = self._execute(f"{text} ORDER BY {order}began, {FOLDER_COLUMN}", "--where")
        return tuple(self._row(values) for values in found)

    def query(self, sql: str) -> tuple[tuple[str, ...], list[tuple[Any, ...]]]:
        """Columns and rows of a SELECT over the table `runs`; ConfigurationError for other SQL."""
        found = self._execute(sql, "--sql")
        return tuple(column[0] for column in found.description or ()), found.fetchall()

    def _execute(self, sql: str, origin: str) -> sqlite3.Cursor:
        try:
            return self._base.execute(sql)
        except (sqlite3.Error, sqlite3.Warning) as error:
            raise ConfigurationError(
                f"{origin}: {error}; columns of runs: {', '.join(RUN_COLUMNS)}"
            ) from None

    def _row(self, values: Sequence[Any]) -> RunRow:
        name, began, *rest = values
        if rest[LIKE_MODEL_PLACE] is not None:  # SQLite knows no truth values
            rest[LIKE_MODEL_PLACE] = bool(rest[LIKE_MODEL_PLACE])
        return RunRow(self._root / name, datetime.fromisoformat(began), *rest)

    def _refresh(self, progress: Progress) -> None:
        """Read new and changed runs into the database, and remove deleted ones."""
        known = {
            str(name): stamp
            for name, *stamp in self._base.execute(
                f"SELECT {FOLDER_COLUMN}, at, head, tail FROM runs"  # noqa: S608
            )
        }
        present = dict(_stamps(self._root))
        changed = [name for name, stamp in present.items() if list(stamp) != known.get(name)]
        for done, name in enumerate(changed):
            progress(done, len(changed))
            self._put(read_row(self._root / name), present[name])
        gone = [(name,) for name in known if name not in present]
        self._base.executemany(f"DELETE FROM runs WHERE {FOLDER_COLUMN} = ?", gone)  # noqa: S608
        self._base.commit()

    def _put(self, row: RunRow, stamp: Stamp) -> None:
        values = values_of(row)
        stamped = (None,) * 3 if row.outcome == UNDER_WAY else stamp  # which is read again
        places = ", ".join("?" * (len(values) + 3))
        self._base.execute(f"INSERT OR REPLACE INTO runs VALUES ({places})", [*values, *stamped])  # noqa: S608


def values_of(row: RunRow) -> tuple[Any, ...]:
    """Values of `row` in the columns RUN_COLUMNS, in SI units."""
    return (row.name, row.began.isoformat(), *astuple(row)[2:])


def _stamps(root: Path) -> Iterable[tuple[str, Stamp]]:
    """Names and modification times [ns] of the runs under `root`, by few system calls."""
    try:
        with os.scandir(root) as found:
            for entry in found:
                if head := _change_time(f"{entry.path}/{RUN}"):
                    tail = _change_time(f"{entry.path}/{RESULT}")
                    yield entry.name, (entry.stat().st_mtime_ns, head, tail)
    except OSError as error:
        raise ConfigurationError(f"{root}: cannot be listed: {error.strerror}") from None


def _change_time(path: str) -> int:
    """Modification time [ns] of the file at `path`; 0 where there is none."""
    try:
        return os.stat(path).st_mtime_ns  # noqa: PTH116  ten thousand paths take a tenth of a second
    except (FileNotFoundError, NotADirectoryError):
        return 0


def _open(path: Path) -> sqlite3.Connection:
    """Open the database at `path`, made anew where it is broken or of another version."""
    for _ in range(2):
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            base = sqlite3.connect(path, timeout=5.0)
            if base.execute("PRAGMA user_version").fetchone()[0] in {0, SCHEMA_VERSION}:
                return _with_tables(base)
            base.close()
        except (sqlite3.DatabaseError, OSError):
            pass
        with suppress(OSError):
            path.unlink(missing_ok=True)
    return _with_tables(sqlite3.connect(":memory:"))


def _with_tables(base: sqlite3.Connection) -> sqlite3.Connection:
    columns = ", ".join(
        (f"{FOLDER_COLUMN} TEXT PRIMARY KEY", *RUN_COLUMNS[1:], "at", "head", "tail")
    )
    base.execute(f"CREATE TABLE IF NOT EXISTS runs ({columns})")
    base.execute(f"PRAGMA user_version = {SCHEMA_VERSION}")
    return base


def _read_only(action: int, *_: str | None) -> int:
    return sqlite3.SQLITE_OK if action in ALLOWED_ACTIONS else sqlite3.SQLITE_DENY
