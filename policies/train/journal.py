"""Journal of a training: its settings and results, from which an interrupted training resumes.

A search is a deterministic function of its seed and its costs. So its journal holds the costs, and
resuming replays them: same state, same result, no pickle. A line is on disk before the next step
begins; a truncated last line is dropped.
"""

import json
from pathlib import Path as FilePath
from typing import Any

from drivers.errors import ConfigurationError
from drivers.files import append_line, write_file, writing
from drivers.readers import MEGABYTE, read_text
from drivers.settings import Settings

Line = dict[str, Any]
LARGEST_JOURNAL = 512 * MEGABYTE  # of hundreds of thousands of generations
OTHER_FOLDER = "name another output folder"


class TrainingJournal:
    """Journal of a training: file of JSON lines, first its `settings`, then lines with `keys`.

    A larger number of `generations` than before extends a training, and the first line records it.
    Raises ConfigurationError for a journal of other settings, for another file, and for a folder
    that cannot be written.
    """

    def __init__(
        self, path: FilePath, settings: Settings, keys: frozenset[str] = frozenset()
    ) -> None:
        """Open the training's journal at `path`, or begin one with `settings`."""
        self.path = path
        self._keys = keys
        with writing(path, OTHER_FOLDER):
            path.parent.mkdir(parents=True, exist_ok=True)
        lines = self._read() if path.exists() else []
        self.lines: list[Line] = lines[1:]
        asked = settings.model_dump(mode="json")
        if lines:
            self._check(lines[0].get("settings"), asked)
        header = {"schema": 1, "settings": asked}
        write_file(path, "".join(map(_line, [header, *self.lines])), OTHER_FOLDER)

    def append(self, line: Line) -> None:
        """Append `line` to the journal's file and flush it to disk."""
        with writing(self.path, OTHER_FOLDER):
            append_line(self.path, _line(line).encode())
        self.lines.append(line)

    def _read(self) -> list[Line]:
        """Lines of the journal, settings first; ConfigurationError for another file."""
        text = read_text(self.path, LARGEST_JOURNAL)
        complete = text[: text.rfind("\n") + 1]
        try:
            lines = [json.loads(line) for line in complete.splitlines()]
        except json.JSONDecodeError:
            raise self._not_a_journal() from None
        mappings = all(isinstance(line, dict) for line in lines)
        if not mappings or not all(line.keys() >= self._keys for line in lines[1:]):
            raise self._not_a_journal()
        if not lines and text and not text.startswith("{"):  # a kill cuts off one line at most
            raise self._not_a_journal()
        return lines

    def _check(self, begun: Any, asked: dict[str, Any]) -> None:
        """Refuse a journal of other settings; more generations are allowed."""
        if not isinstance(begun, dict):
            raise self._not_a_journal()
        differ = [
            f"{key} is {begun.get(key, 'not stated')} there, {asked.get(key, 'not stated')} here"
            for key in dict.fromkeys([*asked, *begun])
            if begun.get(key) != asked.get(key) and key != "generations"
        ]
        done = len(self.lines)
        if asked.get("generations", done) < done:
            differ.append(f"{done} generations are done there, {asked['generations']} asked here")
        if differ:
            raise ConfigurationError(
                f"{self.path}: was begun with other settings ({'; '.join(differ)}); use those, or "
                "another output folder"
            )

    def _not_a_journal(self) -> ConfigurationError:
        return ConfigurationError(f"{self.path}: is not a training journal; {OTHER_FOLDER}")


def _line(content: Line) -> str:
    return json.dumps(content) + "\n"
