"""Run folders as the workflow finds them, and the checks that every subject's tables share."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
from pyarrow import ArrowException

from drivers.errors import ConfigurationError
from drivers.settings import SCHEMA
from drivers.types import Array


def find_runs(paths: Sequence[Path]) -> list[Path]:
    """Run folders among `paths`, each a run folder or a folder of run folders, by name."""
    found: list[Path] = []
    for path in paths:
        if (path / "run.yaml").is_file():
            found.append(path)
            continue
        if not path.is_dir():
            raise ConfigurationError(f"{path}: no such folder; give run folders")
        inner = sorted(p for p in path.iterdir() if (p / "run.yaml").is_file())
        if not inner:
            raise ConfigurationError(f"{path}: holds no run; a run folder holds a run.yaml")
        found += inner
    unique = list(dict.fromkeys(p.resolve() for p in found))
    if len(unique) < 2:
        raise ConfigurationError(
            f"{unique[0] if unique else 'runs'}: a single run cannot be fitted and checked; "
            "give at least two, better ten"
        )
    return unique


def run_names(folders: Sequence[Path]) -> list[str]:
    """Folder names, with their parent's name where they would be equal."""
    short = [f.name for f in folders]
    if len(set(short)) == len(short):
        return short
    return [f"{f.parent.parent.name}/{f.name}" if f.parent.name == "runs"
            else f"{f.parent.name}/{f.name}" for f in folders]  # fmt: skip


def read_table(path: Path) -> dict[str, Array]:
    """Columns of a parquet file as floats; a missing or broken file is a ConfigurationError."""
    try:
        table = pq.read_table(path)
    except FileNotFoundError:
        raise ConfigurationError(f"{path}: is missing") from None
    except (ArrowException, OSError) as error:
        reason = str(error).splitlines()[0]
        raise ConfigurationError(f"{path}: is not a readable parquet file: {reason}") from None
    stored = (table.schema.metadata or {}).get(b"schema", b"1")
    if not stored.isdigit() or int(stored) > SCHEMA:
        raise ConfigurationError(
            f"{path}: schema: is {stored.decode(errors='replace')}, this version reads {SCHEMA}"
        )
    columns = {}
    for name in table.column_names:
        try:
            columns[name] = np.array(table[name], dtype=np.float64)
        except (TypeError, ValueError):
            continue
    return columns


def column(table: dict[str, Array], name: str, path: Path, *, gaps: bool = False) -> Array:
    """A column that must be there, finite throughout unless `gaps` are allowed."""
    if name not in table:
        raise ConfigurationError(f"{path}: {name}: this column is missing (or not numbers)")
    values = table[name]
    if not gaps and not np.isfinite(values).all():
        row = int(np.argmin(np.isfinite(values)))
        raise ConfigurationError(f"{path}: {name}: row {row} is not a number; every row must be")
    return values


def check_time(t: Array, path: Path, least: int) -> None:
    """Refuse a time column that is too short or does not increase."""
    if len(t) < least:
        raise ConfigurationError(f"{path}: t: has {len(t)} rows; at least {least} are needed")
    back = np.diff(t) <= 0.0
    if back.any():
        row = int(np.argmax(back)) + 1
        raise ConfigurationError(
            f"{path}: t: does not increase at row {row} ({t[row - 1]:g} then {t[row]:g} s)"
        )
