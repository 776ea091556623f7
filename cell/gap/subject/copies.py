"""Detects copies of a run: equal measurements under another name, which are counted once."""

import hashlib
from collections.abc import Mapping, Sequence

from cell.gap.subject.run_folders import TABLES, RunFolder, read_table
from drivers.errors import ConfigurationError


def counted_once(runs: Sequence[RunFolder]) -> tuple[tuple[RunFolder, ...], Mapping[str, str]]:
    """Distinct runs, and a mapping from the name of each copy to the name of its original.

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
    """Hash of all measured numbers of a run, however its files encode them.

    For a run that is empty or cannot be read, its path: no other run equals it, and the error is
    reported where the run is read.
    """
    digest, rows = hashlib.sha256(), 0
    for name in TABLES:
        path = run.path / name
        if not path.is_file():
            continue
        try:
            columns = read_table(path)
        except ConfigurationError:
            return str(run.path).encode()
        for key, values in sorted(columns.items()):
            digest.update(f"{name} {key} {len(values)}".encode() + values.tobytes())
            rows += len(values)
    return digest.digest() if rows else str(run.path).encode()
