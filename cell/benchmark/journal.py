"""Finished parts of a benchmark on the disk, so that a benchmark that died goes on."""

import os
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from cell.benchmark.results import AnyResult, Result
from cell.record.documents import json_line, read_json_lines, replace_file
from drivers.errors import ConfigurationError

_ANY: TypeAdapter[Result] = TypeAdapter(AnyResult)


class Journal:
    """Lines of JSON at `path`, a finished part each: its key, what it was made of, its result.

    A line is on the disk when `put` returns. Raises ConfigurationError where that is impossible.
    """

    def __init__(self, path: Path, *, again: bool = False) -> None:
        """Open or begin; `again` forgets what was finished."""
        self.path = path
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            lines = [] if again else read_json_lines(path)
            replace_file(path, b"".join(json_line(line) for line in lines))
        except OSError as error:
            raise ConfigurationError(f"{path}: cannot be written: {error.strerror}") from None
        self._known = {(str(line.get("key")), str(line.get("of"))): line for line in lines}

    def get(self, key: str, of: str) -> Result | None:
        """The result of the part `key` made of the same `of`; None when there is none."""
        line = self._known.get((key, of))
        if line is None:
            return None
        try:
            return _ANY.validate_python(line.get("result"))
        except ValidationError:
            return None  # written by another version: measured again

    def put(self, key: str, of: str, result: Result) -> None:
        """Keep `result`."""
        line = {"key": key, "of": of, "result": result.model_dump(mode="json")}
        self._known[key, of] = line
        with self.path.open("ab") as stream:
            stream.write(json_line(line))
            stream.flush()
            os.fsync(stream.fileno())
