"""Ledger of an exam: the result of every case, from which an interrupted exam resumes."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, ValidationError

from cell.record.documents import json_line
from drivers.files import append_line, replace_file, writing
from drivers.readers import MEGABYTE, read_json_lines
from drivers.settings import Settings
from tests.lab.exam.case import Case
from tests.lab.exam.scoring.score import Outcome

LARGEST_JOURNAL = 512 * MEGABYTE  # of a journal that this program goes on with


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

    def append(self, line: dict[str, Any]) -> None:
        """Write `line`; it is on disk on return."""
        with writing(self.path):
            append_line(self.path, json_line(line))
        self.lines.append(line)


class Oracle(Settings):
    """Result of the true model refitted on the same runs, the best that a verdict can reach.

    `after` is its excess gap on held-out runs, `shrink` the share of the excess that it removes.
    """

    after: float
    shrink: float


class Baselines(Settings):
    """Result of a simpler method, which names the `single` effect with the least in-sample error.

    `right` if that is in the answer. The other baseline, refitting the base alone, names nothing.
    """

    single: str | None
    right: bool


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
        """Open the ledger, or begin one; `again` discards everything."""
        self.path = path
        self._journal = Journal(path, again=again)
        self._known = {e.case.name: e for e in map(_entry, self._journal.lines) if e is not None}

    @property
    def entries(self) -> tuple[Entry, ...]:
        """The newest entry of every case."""
        return tuple(self._known.values())

    def of(self, cases: Iterable[Case]) -> tuple[Entry, ...]:
        """The entries of these cases, in their order."""
        return tuple(self._known[c.name] for c in cases if c.name in self._known)

    def put(self, entry: Entry) -> None:
        """Append the entry of a case."""
        self._known[entry.case.name] = entry
        self._journal.append(entry.model_dump(mode="json"))


def _entry(line: dict[str, object]) -> Entry | None:
    """Parse the entry in a line of JSON; None where another version wrote the line."""
    try:
        return Entry.model_validate(line)
    except ValidationError:
        return None
