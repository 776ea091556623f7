"""Listing and pruning of the runs in a folder."""

import os
import re
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from math import isfinite
from pathlib import Path

from cell.record.files import NOTES, RESULT, RUN, is_run, is_under_way
from cell.record.scalars import Scalar, read_scalars
from drivers.errors import ConfigurationError
from drivers.readers import read_text

Values = dict[str, Scalar]

BEGAN = re.compile(r"(\d{8}T\d{6}Z)-")
UNDER_WAY, DIED, BROKEN = "under way", "died", "broken"


@dataclass(frozen=True, slots=True)
class RunRow:
    """A run in a listing: lengths [m], times [s], `speed` [m/s], None where not known.

    `outcome` is that recorded, or `under way`, `died`, `broken`; `size` is that on disk [bytes];
    `tags` are separated by spaces. `touch` is the time of the layer touch, `predicted` the
    displacement that the policy expected.
    """

    folder: Path
    began: datetime
    strip: str
    policy: str
    outcome: str
    displacement: float | None
    edge_offset: float | None
    duration: float | None
    size: int
    touch: float | None = None
    predicted: float | None = None
    like_model: bool | None = None
    reason: str = ""
    seed: int | None = None
    speed: float | None = None
    start: str = "flat"
    condition: str = ""
    arm: str = ""
    camera: str = ""
    calibration: str = ""
    tags: str = ""
    note: str = ""

    @property
    def name(self) -> str:
        """Name of the run's folder."""
        return self.folder.name


def runs_before(folder: Path, strip: str, most: int) -> tuple[RunRow, ...]:
    """The last `most` runs of `strip` before the run in `folder`, beside it, newest first.

    They are found by their names, so that a folder of thousands is not read.
    """
    place, own = folder.resolve().parent, folder.resolve().name
    try:
        with os.scandir(place) as entries:
            names = [entry.name for entry in entries]
    except OSError:
        return ()
    found = (name for name in names if f"Z-{strip}-" in name and name < own)
    newest = sorted(filter(BEGAN.match, found), reverse=True)[:most]
    return tuple(read_row(place / name) for name in newest if is_run(place / name))


def to_prune(
    rows: Sequence[RunRow],
    now: datetime,
    *,
    keep: int | None = None,
    older_than: timedelta | None = None,
) -> tuple[RunRow, ...]:
    """Runs to delete, oldest first: all but the newest `keep`, or those older than `older_than`.

    With both, a run must satisfy both. A run under way stays, and so does a link: what it leads to
    belongs elsewhere. Raises ConfigurationError when neither is given.
    """
    if keep is None and older_than is None:
        raise ConfigurationError("--keep, --older-than: give one")
    if keep is not None and keep < 0:
        raise ConfigurationError(f"--keep: is {keep}, must be 0 or more")
    ordered = sorted(rows, key=lambda row: (row.began, row.name))
    surplus = ordered if keep is None else ordered[: max(len(ordered) - keep, 0)]
    old = [row for row in surplus if older_than is None or now - row.began > older_than]
    return tuple(r for r in old if r.outcome != UNDER_WAY and not r.folder.is_symlink())


def remove(rows: Sequence[RunRow]) -> int:
    """Delete the folders of `rows`; returns the bytes freed.

    Raises ConfigurationError for a folder that is not a run, is one under way, or a link to one;
    and, once all others are gone, for those that could not be removed.
    """
    for row in rows:
        if row.folder.is_symlink() or not is_run(row.folder) or is_under_way(row.folder):
            raise ConfigurationError(f"{row.folder}: is not a finished run; it was left alone")
    left = []
    for row in rows:
        try:
            shutil.rmtree(row.folder)
        except OSError as error:
            left.append(f"{row.folder}: cannot be removed: {error.strerror}")
    if left:
        raise ConfigurationError("\n".join(left))
    return sum(row.size for row in rows)


def read_row(folder: Path) -> RunRow:
    """Read the row of the run in `folder` from its YAML files."""
    header, result, notes = (_values(folder / name) for name in (RUN, RESULT, NOTES))
    stated, final, notes = header or {}, result or {}, notes or {}
    return RunRow(
        folder=folder,
        began=_start_time(folder),
        strip=_text(stated.get("strip")),
        policy=_text(stated.get("policy")),
        outcome=_outcome(folder, header, result),
        displacement=_number(final.get("displacement")),
        edge_offset=_number(final.get("edge_offset")),
        duration=_number(final.get("duration")),
        size=_size(folder),
        touch=_number(final.get("t_layer_touch")),
        predicted=_number(final.get("foretold.displacement")),
        like_model=_boolean(final.get("agreement.like_model")),
        reason=_text(final.get("reason")),
        seed=_integer(stated.get("seed")),
        speed=_number(stated.get("speed")),
        start=_text(stated.get("start")) or "flat",
        condition=_text(stated.get("condition")),
        arm=_text(stated.get("drivers.arm")),
        camera=_text(stated.get("drivers.camera")),
        calibration=_text(stated.get("calibration.id")),
        tags=_text(notes.get("tags")),
        note=_text(notes.get("note")),
    )


def _outcome(folder: Path, header: Values | None, result: Values | None) -> str:
    if header is None:
        return BROKEN
    if is_under_way(folder):
        return UNDER_WAY
    if result is None:
        return BROKEN if (folder / RESULT).exists() else DIED
    return _text(result.get("outcome")) or BROKEN


def _values(path: Path) -> Values | None:
    if not path.exists():
        return None
    try:
        return read_scalars(read_text(path))
    except (ConfigurationError, ValueError):
        return None


def _size(folder: Path) -> int:
    total = 0
    try:
        with os.scandir(folder) as found:
            for entry in found:
                if entry.is_dir(follow_symlinks=False):
                    total += _size(Path(entry.path))
                elif entry.is_file():
                    total += entry.stat().st_size
    except OSError:  # it has just gone
        return total
    return total


def _start_time(folder: Path) -> datetime:
    stamp = BEGAN.match(folder.name)
    stamped = None if stamp is None else _moment(stamp[1])
    return stamped or _write_time(folder / RUN)


def _write_time(path: Path) -> datetime:
    try:
        return datetime.fromtimestamp(path.stat().st_mtime, UTC)
    except (OSError, OverflowError, ValueError):  # gone, or dated beyond the calendar
        return datetime.fromtimestamp(0, UTC)


def _moment(stamp: str) -> datetime | None:
    try:
        return datetime.strptime(stamp, "%Y%m%dT%H%M%SZ").replace(tzinfo=UTC)
    except ValueError:
        return None


def _number(value: Scalar) -> float | None:
    return value if isinstance(value, float) and isfinite(value) else None


def _integer(value: Scalar) -> int | None:
    number = _number(value)
    return None if number is None or number != int(number) else int(number)


def _boolean(value: Scalar) -> bool | None:
    return value if isinstance(value, bool) else None


def _text(value: Scalar) -> str:
    if isinstance(value, float):
        return f"{value:g}"
    return value if isinstance(value, str) else ""
