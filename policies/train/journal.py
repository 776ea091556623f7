"""Journal of a training run, one line per generation; an interrupted run continues from it.

The optimiser is a deterministic function of its seed and its costs. So the journal holds the costs,
and resuming replays them: same state, same result, no pickle. A line is on disk before the next
generation begins; a truncated last line is dropped.
"""

import json
from pathlib import Path as FilePath
from typing import Any

from drivers.errors import ConfigurationError
from drivers.files import append_line, write_file, writing
from drivers.readers import MEGABYTE, read_text
from policies.train.settings import TrainingSettings

Line = dict[str, Any]
LARGEST_JOURNAL = 512 * MEGABYTE  # of hundreds of thousands of generations
OTHER_FOLDER = "name another output folder"
GENERATION_KEYS = {"asked", "costs", "validated"}  # of a generation, from which the search goes on


class Journal:
    """Append-only file of JSON lines at `path`; the first line states the settings.

    A larger number of generations than before extends a training, and the first line records it.
    Raises ConfigurationError for a journal of other settings, for another file, and for a folder
    that cannot be written.
    """

    def __init__(self, path: FilePath, settings: TrainingSettings) -> None:
        """Open the journal at `path`, or begin one with `settings`."""
        self.path = path
        text = self._read()
        self._lines = self._parse(text)
        header: Line = json.loads(
            json.dumps({"schema": 1, "settings": settings.model_dump(mode="json")})
        )
        if not self._lines:
            self._write_all("")
            self.append(header)
            return
        self._check(header["settings"])
        if self._lines[0] != header or not text.endswith("\n"):  # extended, or cut off by a kill
            self._lines[0] = header
            self._write_all("".join(json.dumps(line) + "\n" for line in self._lines))

    @property
    def generations(self) -> list[Line]:
        """Lines of the generations: all but the first, which states the settings."""
        return self._lines[1:]

    def append(self, line: Line) -> None:
        """Write `line` to disk; it is kept after a crash."""
        with writing(self.path, OTHER_FOLDER):
            append_line(self.path, (json.dumps(line) + "\n").encode())
        self._lines.append(line)

    def _check(self, asked: dict[str, Any]) -> None:
        """Refuse a journal of other settings; more generations than it holds are allowed."""
        begun = self._lines[0].get("settings")
        if not isinstance(begun, dict):
            raise self._not_a_journal()
        done = len(self.generations)
        differ = [
            f"{key} is {begun.get(key, 'not stated')} there, {asked.get(key, 'not stated')} here"
            for key in dict.fromkeys([*asked, *begun])
            if begun.get(key) != asked.get(key) and key != "generations"
        ]
        if asked["generations"] < done:
            differ.append(f"{done} generations are done there, {asked['generations']} asked here")
        if differ:
            raise ConfigurationError(
                f"{self.path}: was begun with other settings ({'; '.join(differ)}); use those, or "
                "another output folder"
            )

    def _read(self) -> str:
        with writing(self.path, OTHER_FOLDER):
            self.path.parent.mkdir(parents=True, exist_ok=True)
        return read_text(self.path, LARGEST_JOURNAL) if self.path.exists() else ""

    def _parse(self, text: str) -> list[Line]:
        """Complete lines of `text`, settings first; refuses what is no training journal."""
        complete = text[: text.rindex("\n")].split("\n") if "\n" in text else []
        try:
            lines = [json.loads(line) for line in complete]
        except json.JSONDecodeError:
            raise self._not_a_journal() from None
        valid = all(isinstance(line, dict) for line in lines) and all(
            line.keys() >= GENERATION_KEYS for line in lines[1:]
        )
        may_be_cut_off = not text or text.startswith("{")  # in its first line, by a kill
        if not valid or not (lines or may_be_cut_off):
            raise self._not_a_journal()
        return lines

    def _write_all(self, text: str) -> None:
        write_file(self.path, text, OTHER_FOLDER)

    def _not_a_journal(self) -> ConfigurationError:
        return ConfigurationError(f"{self.path}: is not a training journal; {OTHER_FOLDER}")
