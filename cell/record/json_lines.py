"""JSON-lines files that survive a crash: each line is on disk before the next one begins."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cell.record.documents import plain
from drivers.files import append_line, replace_file, writing
from drivers.readers import MEGABYTE, read_json_lines

Line = dict[str, Any]
LARGEST_JOURNAL = 512 * MEGABYTE  # of a journal that this program goes on with


def json_line(content: Mapping[str, Any]) -> bytes:
    """Encode `content` as one line of JSON."""
    text = json.dumps(plain(content), ensure_ascii=False, separators=(", ", ": "))
    return text.encode(errors="backslashreplace") + b"\n"


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
