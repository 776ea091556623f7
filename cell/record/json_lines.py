"""JSON-lines files that survive a crash: each line is on disk before the next one begins."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cell.record.documents import plain
from drivers.files import MEGABYTE, append_line, read_bytes, replace_file, writing

Line = dict[str, Any]
LARGEST_EVENTS = 32 * MEGABYTE  # a fold of two minutes writes half of one
LARGEST_JOURNAL = 512 * MEGABYTE  # of a journal that this program goes on with
MOST_LINES = 200_000
DEPTH = 16
DIGITS = 18  # of a whole number that fits 64 bits


def json_line(content: Mapping[str, Any]) -> bytes:
    """Encode `content` as one line of JSON."""
    text = json.dumps(plain(content), ensure_ascii=False, separators=(", ", ": "))
    return text.encode(errors="backslashreplace") + b"\n"


def read_json_lines(path: Path, most: int = LARGEST_EVENTS) -> list[Line]:
    """Read the complete lines of a JSON-lines file of at most `most` bytes; empty without one.

    A truncated last line is skipped. Raises ConfigurationError for a file that is not regular, or
    too large.
    """
    if not path.exists():
        return []
    lines: list[Line] = []
    for line in read_bytes(path, most).split(b"\n", MOST_LINES)[:MOST_LINES]:
        try:
            content = json.loads(line, parse_int=_integer)
        except (ValueError, RecursionError):
            continue
        shallow = line.count(b"{") + line.count(b"[") <= DEPTH  # as all lines of a run are
        if isinstance(content, dict) and (shallow or _is_flat(content, DEPTH)):
            lines.append(content)
    return lines


def _is_flat(value: object, depth: int) -> bool:
    """Whether lists and mappings are nested at most `depth` deep."""
    if isinstance(value, dict):
        value = list(value.values())
    if not isinstance(value, list):
        return True
    return depth > 0 and all(_is_flat(item, depth - 1) for item in value)


def _integer(text: str) -> int | float:
    """Parse a whole number; as a float where it is too large for any index, count or time."""
    return int(text) if len(text) <= DIGITS else float(text)


class Journal:
    """JSON-lines file with a line for each finished item, from which interrupted work goes on.

    Raises ConfigurationError where the file cannot be written.
    """

    def __init__(self, path: Path, *, again: bool = False) -> None:
        """Open or create the file at `path`, without a truncated last line; `again` empties it."""
        self.path = path
        with writing(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            self.lines = [] if again else read_json_lines(path, LARGEST_JOURNAL)
            replace_file(path, b"".join(json_line(line) for line in self.lines))

    def append(self, line: Line) -> None:
        """Write `line`; it is on disk on return."""
        with writing(self.path):
            append_line(self.path, json_line(line))
        self.lines.append(line)
