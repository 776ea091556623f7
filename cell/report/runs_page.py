"""A page that lists runs: thumbnails, links to their pages, filter and sort in the browser."""

import base64
import os
from collections.abc import Sequence
from html import escape
from importlib.resources import files
from pathlib import Path

from cell.record.files import REPORT
from cell.record.frames import decode, read_index
from cell.record.listing import RunRow
from cell.report.markup import Link, masthead, page
from drivers.errors import ConfigurationError
from drivers.files import write_file

PICTURED = 300  # newest runs with a thumbnail; more would make the page heavy
WIDE = 128  # px
HEAD = ("", "run", "strip", "policy", "outcome", "d mm", "edges mm", "s", "tags")


def write_runs_page(rows: Sequence[RunRow], out: Path) -> Path:
    """Write the page that lists `rows`, oldest first, to `out`; its path.

    Raises ConfigurationError where it cannot be written.
    """
    write_file(out, runs_page(rows, out.parent))
    return out


def runs_page(rows: Sequence[RunRow], place: Path) -> str:
    """The page that lists `rows`, for a file in the folder `place`."""
    pictured = {row.name for row in rows[-PICTURED:]}
    lines = "".join(_line(row, place, pictured=row.name in pictured) for row in rows)
    head = "".join(f"<th><button>{name}</button></th>" if name else "<th></th>" for name in HEAD)
    script = files("cell.report").joinpath("runs.js").read_text(encoding="utf-8")
    table = f"<table id=runs><thead><tr>{head}</tr></thead><tbody>{lines}</tbody></table>"
    search = '<input id=filter type=search placeholder="filter" aria-label="filter the runs">'
    body = [
        masthead(f"{len(rows)} runs", ""),
        f'<p>{search} <output id=count></output></p><div class="wide">{table}</div>',
        f"<script>\n{script}</script>",
    ]
    return page(f"{len(rows)} runs", body)


def _line(row: RunRow, place: Path, *, pictured: bool) -> str:
    report = row.folder / REPORT
    link = str(Link(row.name, os.path.relpath(report, place)))
    lengths = ["" if v is None else f"{1e3 * v:+.1f}" for v in (row.displacement, row.edge_offset)]
    words = (row.strip, row.policy, row.outcome.replace("_", " "), *lengths)
    lasted = "" if row.duration is None else f"{row.duration:.1f}"
    cells = [escape(word) for word in (*words, lasted, row.tags)]
    name = link if report.exists() else escape(row.name)
    picture = _thumbnail(row) if pictured else ""
    return "<tr>" + "".join(f"<td>{cell}</td>" for cell in (picture, name, *cells)) + "</tr>"


def _thumbnail(row: RunRow) -> str:
    """The last image that a run kept, small; empty where there is none that can be read."""
    import cv2

    try:
        kept = [note.file for note in read_index(row.folder) if note.file is not None]
        image = decode(kept[-1]) if kept else None
    except ConfigurationError:
        return ""
    if image is None:
        return ""
    size = (WIDE, max(1, round(WIDE * image.shape[0] / image.shape[1])))
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    _, content = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, 60])
    text = base64.b64encode(bytes(content)).decode()
    return f'<img width={WIDE} alt="" src="data:image/jpeg;base64,{text}">'
