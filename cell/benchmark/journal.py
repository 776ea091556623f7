"""Journal of the finished parts of a benchmark, so that an interrupted one continues."""

from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from cell.benchmark.results import AnyResult, Result
from cell.record import json_lines

_ANY: TypeAdapter[Result] = TypeAdapter(AnyResult)


class Journal:
    """One line for each finished part: its key, its inputs' digest, its result.

    Raises ConfigurationError where `path` cannot be written.
    """

    def __init__(self, path: Path, *, again: bool = False) -> None:
        """Open or create; `again` discards what was finished."""
        self._journal = json_lines.Journal(path, again=again)
        lines = self._journal.lines
        self._known = {(str(line.get("key")), str(line.get("of"))): line for line in lines}

    def get(self, key: str, of: str) -> Result | None:
        """The result of the part `key` with the same digest `of`; None when there is none."""
        line = self._known.get((key, of))
        if line is None:
            return None
        try:
            return _ANY.validate_python(line.get("result"))
        except ValidationError:
            return None  # written by another version: measured again

    def put(self, key: str, of: str, result: Result) -> None:
        """Store `result`."""
        line = {"key": key, "of": of, "result": result.model_dump(mode="json")}
        self._known[key, of] = line
        self._journal.append(line)
