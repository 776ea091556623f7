"""The ledger of an exam: the result of every case, from which an interrupted exam resumes."""

from collections.abc import Iterable
from pathlib import Path
from typing import Literal

from pydantic import Field, ValidationError

from cell.exam.case import Case
from cell.exam.scoring.score import Outcome
from cell.record.json_lines import Journal
from drivers.settings import Settings


class Oracle(Settings):
    """Result of the model that knows the truth, refitted on the same runs: its excess gap on the
    same held-out ones, and the share of the excess that it removes.
    """

    after: float
    shrink: float


class Baselines(Settings):
    """Results of simpler methods: the `single` candidate of the least in-sample error, and whether
    that is in the answer. Refitting the base alone never names anything.
    """

    single: str | None
    right: bool


class Entry(Settings):
    """A case in the ledger: the digest of what it was judged by, and its outcome or the reason of
    its failure; `made` where its runs were made and nothing else was asked for.

    `wall` [s] and `memory` [MB, peak] are those of the sealed process; `oracle` is None where
    nothing of the library is hidden; `spreads` are what runs were said to differ by.
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
    """Ledger of lines of JSON at `path`, one a case; the last line of a case counts.

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
    """The entry in a line; None where another version wrote the line."""
    try:
        return Entry.model_validate(line)
    except ValidationError:
        return None
