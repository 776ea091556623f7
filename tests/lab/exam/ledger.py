"""Ledger of an exam: the result of every case, from which an interrupted exam resumes."""

from collections.abc import Iterable
from pathlib import Path
from typing import Literal

from pydantic import Field, ValidationError

from cell.record.documents import json_line
from drivers.files import append_line, replace_file, writing
from drivers.readers import MEGABYTE, read_json_lines
from drivers.settings import Settings
from tests.lab.exam.case import Case
from tests.lab.exam.score import Baselines, Oracle, Outcome

LARGEST_LEDGER = 512 * MEGABYTE


class Entry(Settings):
    """Ledger entry of a case: its state, and its outcome or the `reason` why it failed.

    `of` is the digest of case, engine and scorer; `made` if only its runs were asked for. `wall`
    [s] and `memory` [MB, peak] are the diagnosis's; `oracle` is None where nothing of the
    library is hidden; `spreads` are the estimated run-to-run spreads.
    """

    case: Case
    of: str
    state: Literal["made", "scored", "failed"]
    outcome: Outcome | None = None
    oracle: Oracle | None = None
    baselines: Baselines | None = None
    wall: float = 0.0
    memory: float = 0.0
    spreads: dict[str, float] = Field(default_factory=dict)
    reason: str = ""


class Ledger:
    """Ledger file of JSON lines at `path`, one a case; the last line of a case counts.

    Raises ConfigurationError where `path` cannot be written.
    """

    def __init__(self, path: Path, *, again: bool = False) -> None:
        """Open the ledger without a truncated last line, or begin one; `again` empties it."""
        self.path = path
        with writing(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            lines = [] if again else read_json_lines(path, LARGEST_LEDGER)
            replace_file(path, b"".join(map(json_line, lines)))
        self._known = {e.case.name: e for e in map(_entry, lines) if e is not None}

    @property
    def entries(self) -> tuple[Entry, ...]:
        """The newest entry of every case."""
        return tuple(self._known.values())

    def of(self, cases: Iterable[Case]) -> tuple[Entry, ...]:
        """The entries of these cases, in their order."""
        return tuple(self._known[c.name] for c in cases if c.name in self._known)

    def put(self, entry: Entry) -> None:
        """Append the entry of a case; it is on disk on return."""
        self._known[entry.case.name] = entry
        with writing(self.path):
            append_line(self.path, json_line(entry.model_dump(mode="json")))


def _entry(line: dict[str, object]) -> Entry | None:
    """Parse the entry in a line of JSON; None where another version wrote the line."""
    try:
        return Entry.model_validate(line)
    except ValidationError:
        return None
