"""HTML page that lists runs: thumbnails, links to their pages, filter and sort in the browser."""

import os
from collections.abc import Sequence
from pathlib import Path

from cell.record.files import REPORT
from cell.record.frames import decode, read_index
from cell.record.listing import RunRow
from cell.report.kit import Link, jpeg_text, page
from cell.report.words import plural
from drivers.errors import ConfigurationError
from drivers.files import write_file

PICTURED = 300  # newest runs with a thumbnail; more would make the page heavy
THUMBNAIL_WIDTH = 128  # px
COLUMN_HEADINGS = ("run", "strip", "policy", "outcome", "d mm", "edges mm", "s", "tags")


def write_runs_page(rows: Sequence[RunRow], out: Path) -> Path:
    """Write the page that lists `rows`, oldest first, to `out`; returns its path.

    Raises ConfigurationError where it cannot be written.
    """
    write_file(out, runs_page(rows, out.parent))
    return out


def runs_page(rows: Sequence[RunRow], place: Path) -> str:
    """HTML page that lists `rows`, for a file in the folder `place`."""
    pictured = {row.name for row in rows[-PICTURED:]}
    return page(
        "report/templates/runs.html",
        plural(len(rows), "run"),
        title=plural(len(rows), "run"),
        head=COLUMN_HEADINGS,
        wide=THUMBNAIL_WIDTH,
        rows=[
            (_thumbnail(row) if row.name in pictured else "", _cells(row, place)) for row in rows
        ],
    )


def _cells(row: RunRow, place: Path) -> tuple[str | Link, ...]:
    report = row.folder / REPORT
    name = Link(row.name, os.path.relpath(report, place)) if report.exists() else row.name
    lengths = ("" if v is None else f"{1e3 * v:+.1f}" for v in (row.displacement, row.edge_offset))
    lasted = "" if row.duration is None else f"{row.duration:.1f}"
    outcome = row.outcome.replace("_", " ")
    return (name, row.strip, row.policy, outcome, *lengths, lasted, row.tags)


def _thumbnail(row: RunRow) -> str:
    """Last kept image of a run, small, as JPEG in text form; empty where none can be read."""
    try:
        kept = [note.file for note in read_index(row.folder) if note.file is not None]
        image = decode(kept[-1]) if kept else None
    except ConfigurationError:
        return ""
    return "" if image is None else jpeg_text(image, THUMBNAIL_WIDTH, quality=60)
