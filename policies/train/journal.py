"""Journal of a training: its settings and results, from which an interrupted training
resumes.

A search is a deterministic function of its seed and its costs. So its journal holds the
costs, and resuming replays them: same state, same result, no pickle. A line is on disk
before the next step begins; a truncated last line is dropped.
"""

import json
import os
from pathlib import Path as FilePath
from typing import Any

from drivers.base.errors import ConfigurationError
from drivers.base.files import append_line, write_file, writing
from drivers.base.readers import MEGABYTE, read_json_lines
from drivers.base.settings import Settings

Line = dict[str, Any]
JOURNALS = {"feedback": "feedback.jsonl", "adaptive": "adaptive.json"}  # by policy
LARGEST_JOURNAL = 512 * MEGABYTE  # of hundreds of thousands of generations
OTHER_FOLDER = "name another output folder"


class TrainingJournal:
    """Journal of a training: file of JSON lines, first its `settings`, then lines with
    `keys`.

    The first line has the process and host that last went on with it, too. A larger
    number of `generations` than before extends a training, and that line records it.
    Raises ConfigurationError for a journal of other settings, for another file, and for
    a folder that cannot be written.
    """

    def __init__(
        self, path: FilePath, settings: Settings, keys: frozenset[str]
    ) -> None:
        """Open the training's journal at `path`, or begin one with `settings`."""
        self.path = path
        with writing(path, OTHER_FOLDER):
            path.parent.mkdir(parents=True, exist_ok=True)

        asked = settings.model_dump(mode="json")
        first, *self.lines = read_json_lines(path, LARGEST_JOURNAL) or [{}]
        begun = first.get("settings")
        if isinstance(begun, dict) and all(line.keys() >= keys for line in self.lines):
            self._check(begun, asked)
        elif path.exists():
            raise ConfigurationError(
                f"{path}: is not a training journal; {OTHER_FOLDER}"
            )

        made_by = {"process": os.getpid(), "host": os.uname().nodename}
        header = {"schema": 1, "settings": asked, **made_by}
        write_file(path, "".join(map(_line, [header, *self.lines])), OTHER_FOLDER)

    def append(self, line: Line) -> None:
        """Append `line` to the journal's file and flush it to disk."""
        with writing(self.path, OTHER_FOLDER):
            append_line(self.path, _line(line).encode())
        self.lines.append(line)

    def _check(self, begun: dict[str, Any], asked: dict[str, Any]) -> None:
        """Refuse a journal of other settings; more generations are allowed."""
        differ = [
            f"{key} is {begun.get(key, 'not stated')} there,"
            f" {asked.get(key, 'not stated')} here"
            for key in dict.fromkeys([*asked, *begun])
            if begun.get(key) != asked.get(key) and key != "generations"
        ]
        done = len(self.lines)
        if asked.get("generations", done) < done:
            differ.append(
                f"{done} generations are done there, {asked['generations']} asked here"
            )
        if differ:
            raise ConfigurationError(
                f"{self.path}: was begun with other settings ({'; '.join(differ)}); use"
                " those, or another output folder"
            )


def _line(content: Line) -> str:
    return json.dumps(content) + "\n"
