"""The runs of a folder without the catalogue: what it must hold."""

from pathlib import Path

from cell.record.files import is_run
from cell.record.listing import RunRow, read_row


def list_runs(root: Path) -> tuple[RunRow, ...]:
    """The runs directly under `root`, oldest first."""
    rows = [read_row(folder) for folder in root.iterdir() if is_run(folder)]
    return tuple(sorted(rows, key=lambda row: (row.began, row.name)))
