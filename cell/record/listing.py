"""Listing and pruning of the runs in a folder."""

import re
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from math import isfinite
from pathlib import Path
from typing import Any

from cell.record.files import RESULT, RUN, is_run, is_under_way
from drivers.errors import ConfigurationError
from drivers.settings import read_yaml

BEGAN = re.compile(r"(\d{8}T\d{6}Z)-")
UNDER_WAY, DIED, BROKEN = "under way", "died", "broken"


@dataclass(frozen=True, slots=True)
class RunRow:
    """One run: `outcome` as recorded, or `under way`, `died`, `broken`; `displacement` [m] and
    `duration` [s] where known; `size` on disk [bytes].
    """

    folder: Path
    began: datetime
    strip: str
    policy: str
    outcome: str
    displacement: float | None
    duration: float | None
    size: int

    @property
    def name(self) -> str:
        """Name of the folder."""
        return self.folder.name


def list_runs(root: Path) -> tuple[RunRow, ...]:
    """The runs directly under `root`, oldest first.

    Raises ConfigurationError when `root` is no folder.
    """
    if not root.is_dir():
        raise ConfigurationError(f"{root}: is not a folder; name one with --runs")
    try:
        rows = [_row(folder) for folder in root.iterdir() if is_run(folder)]
    except OSError as error:
        raise ConfigurationError(f"{root}: cannot be listed: {error.strerror}") from None
    return tuple(sorted(rows, key=lambda row: (row.began, row.name)))


def to_prune(
    rows: Sequence[RunRow],
    now: datetime,
    *,
    keep: int | None = None,
    older_than: timedelta | None = None,
) -> tuple[RunRow, ...]:
    """The runs that may be deleted, oldest first: all but the newest `keep`, or those `older_than`.

    With both, a run must satisfy both. A run under way stays. Raises ConfigurationError when
    neither is given.
    """
    if keep is None and older_than is None:
        raise ConfigurationError("prune: say how many runs to keep or how old they may be")
    if keep is not None and keep < 0:
        raise ConfigurationError(f"prune: keep: is {keep}, must be 0 or more")
    ordered = sorted(rows, key=lambda row: (row.began, row.name))
    surplus = ordered if keep is None else ordered[: max(len(ordered) - keep, 0)]
    old = [row for row in surplus if older_than is None or now - row.began > older_than]
    return tuple(row for row in old if row.outcome != UNDER_WAY)


def remove(rows: Sequence[RunRow]) -> int:
    """Delete the folders of `rows`; returns the bytes freed.

    Raises ConfigurationError for a folder that is not a run, or is one under way.
    """
    for row in rows:
        if not is_run(row.folder) or is_under_way(row.folder):
            raise ConfigurationError(f"{row.folder}: is not a finished run; it was left alone")
    for row in rows:
        try:
            shutil.rmtree(row.folder)
        except OSError as error:
            raise ConfigurationError(f"{row.folder}: cannot be removed: {error.strerror}") from None
    return sum(row.size for row in rows)


def _row(folder: Path) -> RunRow:
    header, result = _document(folder / RUN), _document(folder / RESULT)
    return RunRow(
        folder=folder,
        began=_began(folder),
        strip=str((header or {}).get("strip", "")),
        policy=str((header or {}).get("policy", "")),
        outcome=_outcome(folder, header, result),
        displacement=_number((result or {}).get("displacement")),
        duration=_number((result or {}).get("duration")),
        size=sum(_size(path) for path in folder.rglob("*")),
    )


def _outcome(folder: Path, header: dict[str, Any] | None, result: dict[str, Any] | None) -> str:
    if header is None:
        return BROKEN
    if is_under_way(folder):
        return UNDER_WAY
    if result is None:
        return BROKEN if (folder / RESULT).exists() else DIED
    return str(result.get("outcome", BROKEN))


def _document(path: Path) -> dict[str, Any] | None:
    if not path.exists():
        return None
    try:
        return read_yaml(path)
    except ConfigurationError:
        return None


def _size(path: Path) -> int:
    try:
        return path.stat().st_size if path.is_file() else 0
    except OSError:  # it has just gone
        return 0


def _began(folder: Path) -> datetime:
    stamp = BEGAN.match(folder.name)
    stamped = None if stamp is None else _moment(stamp[1])
    return stamped or _written(folder / RUN)


def _written(path: Path) -> datetime:
    try:
        return datetime.fromtimestamp(path.stat().st_mtime, UTC)
    except (OSError, OverflowError, ValueError):  # gone, or dated beyond the calendar
        return datetime.fromtimestamp(0, UTC)


def _moment(stamp: str) -> datetime | None:
    try:
        return datetime.strptime(stamp, "%Y%m%dT%H%M%SZ").replace(tzinfo=UTC)
    except ValueError:
        return None


def _number(value: Any) -> float | None:
    usable = isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)
    return float(value) if usable else None
