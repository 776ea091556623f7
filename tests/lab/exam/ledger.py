"""Ledger of an exam: the results of its journal in one file, to go on elsewhere."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, ValidationError

from cell.record.documents import json_line
from drivers.base.files import replace_file, writing
from drivers.base.readers import MEGABYTE, read_json_lines
from drivers.base.settings import Settings
from tests.lab.exam.case import Case
from tests.lab.exam.score import Oracle, Outcome

LARGEST_LEDGER = 512 * MEGABYTE


class Entry(Settings):
    """Ledger entry of a case: its state, and its outcome or the `reason` why it failed.

    `of` is the digest of case, engine and scorer; `made` if only its runs were asked
    for. `wall` [s] and `memory` [MB, peak] are the diagnosis's; `oracle` is None where
    nothing of the library is hidden; `spreads` are the estimated run-to-run spreads.
    """

    case: Case
    of: str
    state: Literal["made", "scored", "failed"]
    outcome: Outcome | None = None
    oracle: Oracle | None = None
    baselines: Any = None  # of ledgers of before
    wall: float = 0.0
    memory: float = 0.0
    spreads: dict[str, float] = Field(default_factory=dict)
    reason: str = ""


def read_ledger(path: Path) -> dict[str, Entry]:
    """The newest entry of every case in the JSON lines at `path`, by the case's name.

    Lines that another version wrote, or a kill cut off, are left out.
    """
    entries = filter(None, map(_entry, read_json_lines(path, LARGEST_LEDGER)))
    return {entry.case.name: entry for entry in entries}


def write_ledger(path: Path, entries: Iterable[Entry]) -> None:
    """Write `entries` to `path`, a line each; raises ConfigurationError where that
    fails.
    """
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        lines = (json_line(entry.model_dump(mode="json")) for entry in entries)
        replace_file(path, b"".join(lines))


def _entry(line: dict[str, object]) -> Entry | None:
    """Parse the entry in a line of JSON; None where another version wrote the line."""
    try:
        return Entry.model_validate(line)
    except ValidationError:
        return None
