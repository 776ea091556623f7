"""Runs a campaign: has an engine measure the parts that have no record."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Protocol

from cell.campaign.journal import Journal, Record
from cell.campaign.part import Part
from cell.campaign.versions import versions
from drivers.files import writing


class Engine(Protocol):
    """Protocol of an engine that measures parts, here or on other machines."""

    def measure(
        self, parts: Sequence[Part], folder: Path, versions: Mapping[str, str]
    ) -> Iterator[Record]:
        """Yield the records of `parts` as they finish, each stored in the journal at `folder`."""


class Watcher(Protocol):
    """Protocol of an observer of a campaign, called at its start and after each part."""

    def begin(self, parts: Sequence[Part], known: Sequence[Part]) -> None:
        """Called first: `parts` are wanted, of which `known` are done."""

    def finish(self, part: Part, record: Record) -> None:
        """Called after each part."""


def carry_out(
    parts: Sequence[Part], folder: Path, engine: Engine, watcher: Watcher, *, again: bool = False
) -> Iterator[tuple[Part, Record]]:
    """Yield every part with its record, finished ones first, then the others as they finish.

    The journal at `folder` keeps the records; `again` measures all parts anew. Raises CellError
    where the journal cannot be written or the workers are gone, KeyboardInterrupt from the
    keyboard; finished parts are kept in either case.
    """
    journal, wanted = Journal(folder), {(part.key, part.of): part for part in parts}
    if again:
        journal.forget(wanted)
    found = {name: journal.get(*name) for name in wanted}
    known = {name: record for name, record in found.items() if record and record.done}
    watcher.begin(parts, [wanted[name] for name in known])
    for name, record in known.items():
        yield wanted[name], record
    left = [part for name, part in wanted.items() if name not in known]
    if not left:
        return
    make_folder(folder)
    for record in engine.measure(left, folder, versions()):
        part = wanted[record.key, record.of]
        watcher.finish(part, record)
        yield part, record


def make_folder(folder: Path) -> None:
    """Make `folder`, which workers must find; raises ConfigurationError where that fails."""
    with writing(f"--out: {folder}", "name another folder"):
        folder.mkdir(parents=True, exist_ok=True)
