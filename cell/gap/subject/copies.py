"""Detects copies of a run: equal measurements under another name, which are counted once."""

import hashlib
from collections.abc import Mapping, Sequence

from cell.gap.subject.run_folders import TABLES, RunFolder, read_table
from drivers.errors import ConfigurationError


def counted_once(runs: Sequence[RunFolder]) -> tuple[tuple[RunFolder, ...], Mapping[str, str]]:
    """The first run of each measurement, and the names of its copies -> its name.

    Noise makes no two runs alike in every number, however well they repeat. Raises
    ConfigurationError where a single run is left.
    """
    first, copies = dict[bytes, RunFolder](), dict[str, str]()
    for run in runs:
        known = first.setdefault(_digest(run), run)
        if known is not run:
            copies[run.name] = known.name
    if len(first) < 2:
        raise ConfigurationError(
            f"{runs[0].path}: {len(runs)} runs hold the same measurement; a single run cannot be "
            "fitted and checked; give at least two that were measured, better ten"
        )
    return tuple(first.values()), copies


def note(copy: str, first: str) -> str:
    """Remark for the operator on a copied run."""
    return f"{copy}: holds the measurements of {first}, as a copy does, and is left out"


def _digest(run: RunFolder) -> bytes:
    """Hash of every number that was measured, whatever the files are encoded like.

    A run of nothing, or whose tables cannot be read, is like no other; who reads it next says so.
    """
    h, rows = hashlib.sha256(), 0
    for name in TABLES:
        path = run.path / name
        if not path.is_file():
            continue
        try:
            columns = read_table(path)
        except ConfigurationError:
            return str(run.path).encode()
        for key, values in sorted(columns.items()):
            h.update(f"{name} {key} {len(values)}".encode() + values.tobytes())
            rows += len(values)
    return h.digest() if rows else str(run.path).encode()
