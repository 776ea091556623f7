"""Runs an exam: makes runs, diagnoses them in a process apart, keeps scores."""

from collections import Counter
from collections.abc import Sequence
from operator import itemgetter
from pathlib import Path
from tempfile import TemporaryDirectory

from cell.campaign.journal import Journal, Record
from cell.campaign.local import Local
from cell.campaign.progress import Quiet
from cell.campaign.run import Engine, Watcher, carry_out
from tests.lab.exam.case import Case, Kind
from tests.lab.exam.cases import Sources, sources
from tests.lab.exam.ledger import Entry, Ledger
from tests.lab.exam.run_case import ExamPart, Maker, Steps, made_by_tier

LEDGER, JOURNAL = "ledger.jsonl", "journal"


def run_exam(
    cases: Sequence[Case],
    folder: Path,
    *,
    engine: Engine | None = None,
    watcher: Watcher | None = None,
    steps: Steps = "all",
    again: bool = False,
    make: Maker = made_by_tier,
    ledger: Path | None = None,
) -> tuple[Entry, ...]:
    """Measure `cases` by `engine`, one at a time where None, and return their ledger entries.

    Entries in the journal of `folder` or the file `ledger` by the same engine and scorer are not
    measured again, runs are kept while their case stays the same; `again` diagnoses anew. A case
    that fails is an entry with its reason, tried again at the next start. Kinds take turns, so that
    an exam that ends early has seen all of them.
    """
    kept, now, named = Ledger(ledger or folder / LEDGER), sources(), {c.name: c for c in cases}
    with TemporaryDirectory(prefix="exam-", ignore_cleanup_errors=True) as workdirs:
        parts = [
            ExamPart(case, folder, Path(workdirs), now, now.entry(case), steps, make, again)
            for case in spread(cases)
        ]
        anew = again or steps == "make"
        if not anew:
            _import_ledger(kept, Journal(folder / JOURNAL), parts)
        place, seen = folder / JOURNAL, watcher or Quiet()
        for part, record in carry_out(parts, place, engine or Local(), seen, again=anew):
            entry = entry_of(named[part.key], now, record)
            if entry.state != "made" and kept.of([entry.case]) != (entry,):
                kept.put(entry)
    return kept.of(cases)


def entry_of(case: Case, now: Sources, record: Record) -> Entry:
    """Ledger entry of `case` from its campaign record; a failed entry where it has no outcome."""
    if record.outcome is None:
        return Entry(case=case, of=now.entry(case), state="failed", reason=record.reason)
    return Entry.model_validate(record.outcome)


def _import_ledger(kept: Ledger, journal: Journal, parts: Sequence[ExamPart]) -> None:
    """Copy a ledger's outcomes into the journal, so that an exam can resume elsewhere."""
    known = {(entry.case.name, entry.of): entry for entry in kept.entries}
    for part in parts:
        entry = known.get((part.key, part.of))
        if entry is not None and entry.state == "scored" and not journal.get(part.key, part.of):
            outcome = entry.model_dump(mode="json")
            record = Record(schema=1, key=part.key, of=part.of, state="measured", outcome=outcome)
            journal.put(record)


def spread(cases: Sequence[Case]) -> list[Case]:
    """Order the cases so that every kind is spread evenly over the whole."""
    of_kind = Counter(case.kind for case in cases)
    seen: Counter[Kind] = Counter()
    places = []
    for case in cases:
        places.append((seen[case.kind] + 0.5) / of_kind[case.kind])
        seen[case.kind] += 1
    return [case for _, case in sorted(zip(places, cases, strict=True), key=itemgetter(0))]


def summarise(record: Record) -> str:
    """Result of a case in a few words, for the progress report."""
    if record.outcome is None:
        return f": failed: {record.reason}"
    scored = record.outcome["outcome"]
    return f": {scored['result'].replace('_', ' ')}" if scored else ": runs made"
