"""Finds folders of measured runs, and leaves out copies."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cell.gap.subject.run_table import read_table
from cell.record.files import ANGLES, JOINTS, PROFILE, RUN, SIGNALS, TICKS, runs_in
from drivers.base.errors import ConfigurationError
from drivers.base.files import encoded
from drivers.base.types import Array

TABLES = (TICKS, PROFILE, ANGLES, SIGNALS, JOINTS)

# m, rad, N by which copies of one number differ that was written in other units
ROUNDING = 1e-5
TIME_ROUNDING = 1e-3  # s
Numbers = Mapping[tuple[str, str], Array]


class RunFolder(NamedTuple):
    """Folder of a measured run, with a name that is unique among the runs found
    together.
    """

    path: Path
    name: str


def find_runs(paths: Sequence[Path]) -> tuple[RunFolder, ...]:
    """Run folders at or in `paths`: each is a run folder, or a folder that holds run
    folders.

    Raises ConfigurationError for a single run, for a folder without runs, and for
    measurements that lie beside no run.yaml.
    """
    unique = _unique(paths)
    if len(unique) < 2:
        raise ConfigurationError(
            f"{unique[0] if unique else 'runs'}: one run cannot be both fitted and held"
            " out; give at least two, better ten"
        )
    return tuple(RunFolder(p, n) for p, n in zip(unique, _names(unique), strict=True))


def _unique(paths: Sequence[Path]) -> list[Path]:
    """Distinct run folders at or in `paths`; ConfigurationError for a path without
    runs.
    """
    found: list[Path] = []
    for path in paths:
        _check_heads([path, *path.glob("*")])
        inner = runs_in(path)
        if not inner:
            what = "is a file" if path.exists() else "no such folder"
            if path.is_dir():
                what = f"holds no run, a run folder holds a {RUN}"
            raise ConfigurationError(
                f"{path}: {what}; give run folders, or a folder of them"
            )
        found += inner
    return list(dict.fromkeys(p.resolve() for p in found))


def _check_heads(folders: Sequence[Path]) -> None:
    """Raise ConfigurationError for folders that hold a run's table but no
    header file.
    """
    for folder in sorted(folders):
        tables = [name for name in TABLES if (folder / name).is_file()]
        if tables and not (folder / RUN).is_file():
            raise ConfigurationError(
                f"{folder}: {RUN}: is missing beside {tables[0]}; add it, or take the"
                " folder away"
            )


def _names(folders: Sequence[Path]) -> list[str]:
    """Unique names of run folders, in UTF-8: all with a parent's name if two would be
    equal.
    """
    short = [_utf8(f.name) for f in folders]
    if len(set(short)) == len(short):
        return short

    parents = [f.parents[1] if f.parent.name == "runs" else f.parent for f in folders]
    found: dict[str, Path] = {}
    for parent, folder in zip(parents, folders, strict=True):
        name = _utf8(f"{parent.name}/{folder.name}")
        if name in found:
            raise ConfigurationError(
                f"{folder}: has the name of {found[name]}; rename one of them"
            )
        found[name] = folder

    return [*found]


def _utf8(name: str) -> str:
    """`name` as valid UTF-8, other bytes escaped."""
    return encoded(name).decode()


def check_indices(folders: Sequence[Path], stated: Sequence[int | None]) -> None:
    """Raise ConfigurationError where two runs state the same index in the order of
    measurement.

    An index that is equal in all runs, as single folds write it, states no order and is
    allowed.
    """
    first: dict[int, Path] = {}
    same = len({index for index in stated if index is not None}) == 1
    for folder, index in zip(folders, stated, strict=True):
        if index is None or same:
            continue
        if index in first:
            raise ConfigurationError(
                f"{folder / RUN}: index: is {index}, as in {first[index].name}; give"
                " each run of a specimen its own, in the order in which they were"
                " taken, or none; of an imported run `runs` in the mapping states it"
            )
        first[index] = folder


def without_copies(
    runs: Sequence[RunFolder],
) -> tuple[tuple[RunFolder, ...], Mapping[str, str]]:
    """Runs without copies, and a mapping from the name of each copy to that of its
    original.

    Noise makes no two runs alike in every number, however well they repeat. Raises
    ConfigurationError where of several a single one is left.
    """
    copies = _find_copies(runs)
    first = tuple(run for run in runs if run.name not in copies)
    if len(first) == 1 < len(runs):
        raise ConfigurationError(
            f"{runs[0].path}: {len(runs)} runs hold the same measurement; a single run"
            " cannot be fitted and checked; give at least two that were measured,"
            " better ten"
        )
    return first, copies


def _find_copies(runs: Sequence[RunFolder]) -> dict[str, str]:
    """Name of the original of each copy among `runs`, by the name of the copy."""
    first: dict[RunFolder, Numbers] = {}
    copies: dict[str, str] = {}
    for run in runs:
        numbers = _numbers(run)
        known = next(
            (other for other, its in first.items() if _are_same(numbers, its)), None
        )
        if known is None:
            first[run] = numbers
        else:
            copies[run.name] = known.name
    return copies


def copy_note(copy: str, first: str) -> str:
    """Remark for the operator that run `copy` holds the measurements of run `first`."""
    return f"{copy}: holds the measurements of {first}, as a copy does, and is left out"


def _numbers(run: RunFolder) -> Numbers:
    """Measured numbers of a run by table and column, whatever the encoding of its
    files.

    Empty for a run that cannot be read: no other equals it, and where it is read the
    error is said.
    """
    found: dict[tuple[str, str], Array] = {}
    for name in TABLES:
        path = run.path / name
        try:
            table = read_table(path) if path.is_file() else {}
        except ConfigurationError:
            return {}
        for key, values in table.items():
            known = np.isfinite(values)
            if known.any():
                found[name, key] = values[known]
    return found


def _are_same(one: Numbers, other: Numbers) -> bool:
    """Whether all columns that two runs share agree within the rounding of units and
    decimals.
    """
    shared = {key: (one[key], other[key]) for key in one.keys() & other.keys()}
    return any(key != "t" for _, key in shared) and all(
        len(a) == len(b)
        and np.abs(a - b).max() <= (TIME_ROUNDING if key == "t" else ROUNDING)
        for (_, key), (a, b) in shared.items()
    )
