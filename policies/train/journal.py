"""The record of a training run, a line a generation; from it a killed run goes on.

The optimiser is a deterministic function of its seed and of the costs that it was told. So the
journal holds the costs, and resuming tells them again: same state, same result, no pickle. A line
is on disk before the next generation begins; one that was cut off by a kill is dropped.
"""

import json
import os
from collections.abc import Iterator
from pathlib import Path as FilePath
from typing import Any

from drivers.errors import ConfigurationError
from policies.train.settings import TrainingSettings

Line = dict[str, Any]


class Journal:
    """Append-only lines of JSON at `path`; the first states the settings."""

    def __init__(self, path: FilePath, settings: TrainingSettings) -> None:
        """Open or begin; refuses, as ConfigurationError, a journal of other settings."""
        self.path = path
        path.parent.mkdir(parents=True, exist_ok=True)
        self._lines = list(_whole_lines(path))
        header = {"schema": 1, "settings": settings.model_dump(mode="json")}
        if not self._lines:
            path.write_text("", encoding="utf-8")
            self.append(header)
        elif self._lines[0] != json.loads(json.dumps(header)):
            raise ConfigurationError(
                f"{path}: was begun with other settings; use those, or another output folder"
            )
        else:
            self._drop_torn_end()

    @property
    def generations(self) -> list[Line]:
        """The lines after the settings."""
        return self._lines[1:]

    def append(self, line: Line) -> None:
        """Write `line`; on return it survives a kill."""
        with self.path.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps(line) + "\n")
            stream.flush()
            os.fsync(stream.fileno())
        self._lines.append(line)

    def _drop_torn_end(self) -> None:
        whole = "".join(json.dumps(line) + "\n" for line in self._lines)
        if self.path.read_text(encoding="utf-8") != whole:
            partial = self.path.with_name(self.path.name + ".partial")
            partial.write_text(whole, encoding="utf-8")
            partial.replace(self.path)


def _whole_lines(path: FilePath) -> Iterator[Line]:
    if not path.exists():
        return
    for text in path.read_text(encoding="utf-8").splitlines(keepends=True):
        if not text.endswith("\n"):
            return
        try:
            yield json.loads(text)
        except json.JSONDecodeError:
            raise ConfigurationError(
                f"{path}: is not a training journal; name another output folder"
            ) from None
