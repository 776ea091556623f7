"""Runs an exam: makes the runs of each case, diagnoses them in a process apart, keeps
scores.
"""

import json
import shutil
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from operator import itemgetter
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from cell.base.campaign.journal import Journal, Record
from cell.base.campaign.progress import Meter
from cell.base.campaign.run import Engine, Local, Part, carry_out
from cell.base.config.places import find_configs
from cell.gap.subject.run_folders import find_runs
from cell.gap.verdict.schema import read_verdict
from drivers.base.files import replace_file
from drivers.strip.describe import load_strip
from tests.lab.exam.case import Case, Kind
from tests.lab.exam.cases import Sources, case_hash, sources
from tests.lab.exam.diagnosis import NOTES, VERDICT_FILE, Effort, diagnose
from tests.lab.exam.ledger import Entry, read_ledger, write_ledger
from tests.lab.exam.score import oracle, score

Maker = Callable[[Case, Path], object]
RUNS_FOLDER, VERDICTS_FOLDER, STAMP, MADE = "runs", "verdicts", "diagnosed.json", "made"
LEDGER, JOURNAL = "ledger.jsonl", "journal"
CASE_COST = 60.0  # s of one core, about


def made_by_tier(case: Case, folder: Path) -> None:
    """Make the runs of `case` in `folder`, through images or from the state by its
    tier.
    """
    if case.tier == "images":
        from tests.lab.exam import through_images

        through_images.make_runs(case, folder)
        return
    from tests.lab.exam.from_state import make_runs

    make_runs(case, folder)


def measure_case(
    case: Case,
    folder: Path,
    workdirs: Path,
    by: Sources,
    judged: bool,
    make: Maker,
    again: bool,
) -> Mapping[str, Any]:
    """Make the runs of `case`, diagnose them, score the verdict: its ledger entry as
    plain values.

    Runs and verdict lie in `folder`; the diagnosis works within `workdirs`, or among
    the temporary files of a machine that has no such folder. Raises CellError where a
    step fails.
    """
    place = folder / RUNS_FOLDER / case.name
    keep_runs(case, place, make)
    if not judged:
        return Entry(case=case, of=by.entry(case), state="made").model_dump(mode="json")
    shared = workdirs if workdirs.is_dir() else None
    return judge(case, folder, by, workdirs=shared, again=again).model_dump(mode="json")


def keep_runs(case: Case, place: Path, make: Maker) -> None:
    """Make the runs of `case` at `place`, unless those there belong to this very
    case.
    """
    if read_stamp(place) == case_hash(case):
        return
    scratch = place.with_name(place.name + ".part")
    for old in (scratch, place):
        shutil.rmtree(old, ignore_errors=True)
    scratch.mkdir(parents=True)
    make(case, scratch)
    (scratch / MADE).write_text(case_hash(case), encoding="utf-8")
    scratch.replace(place)


def read_stamp(place: Path) -> str | None:
    """Digest of the case to which the runs at `place` belong; None without runs."""
    try:
        return (place / MADE).read_text(encoding="utf-8")
    except OSError:
        return None


def judge(
    case: Case, folder: Path, by: Sources, *, workdirs: Path | None, again: bool = False
) -> Entry:
    """Diagnose and score the runs of `case`; a stored verdict of the same engine is
    reused.
    """
    strip = find_configs(None).strip_path(case.strip)
    runs, out = (
        find_runs([folder / RUNS_FOLDER / case.name]),
        folder / VERDICTS_FOLDER / case.name,
    )
    effort = None if again else _stored_verdict(out, by.verdict(case))
    if effort is None:
        shutil.rmtree(out, ignore_errors=True)
        paths = [run.path for run in runs]
        effort = diagnose(strip, paths, out, workdirs=workdirs)
        facts = {"of": by.verdict(case), **asdict(effort)}
        replace_file(out / STAMP, json.dumps(facts).encode())
    verdict = read_verdict(out / VERDICT_FILE)
    notes = json.loads((out / NOTES).read_text(encoding="utf-8"))
    return Entry(
        case=case,
        of=by.entry(case),
        state="scored",
        outcome=score(verdict, case, load_strip(strip)),
        oracle=oracle(case, strip, runs, verdict.held_out) if case.answer else None,
        wall=effort.wall,
        memory=effort.memory,
        spreads=notes.get("scatter", {}),
    )


def _stored_verdict(out: Path, of: str) -> Effort | None:
    """Effort of a stored verdict; None without a verdict that has the digest `of`."""
    try:
        facts = json.loads((out / STAMP).read_text(encoding="utf-8"))
        if facts["of"] == of:
            return Effort(facts["wall"], facts["memory"])
    except (OSError, ValueError, KeyError):
        pass
    return None


def run_exam(
    cases: Sequence[Case],
    folder: Path,
    *,
    engine: Engine | None = None,
    meter: Meter | None = None,
    judged: bool = True,
    again: bool = False,
    make: Maker = made_by_tier,
) -> tuple[Entry, ...]:
    """Measure `cases` by `engine`, one at a time where None, and return their ledger
    entries.

    Entries in the journal or the ledger of `folder` by the same engine and scorer are
    not measured again, runs are kept while their case stays the same; `again` diagnoses
    anew. A case that fails is an entry with its reason, tried again at the next start.
    Kinds take turns, so that an exam that ends early has seen all of them.
    """
    place = folder / JOURNAL
    path = folder / LEDGER
    now = sources()
    kept = read_ledger(path)
    named = {case.name: case for case in cases}
    write_ledger(path, kept.values())  # fails now, and not after hours
    with TemporaryDirectory(prefix="exam-", ignore_cleanup_errors=True) as workdirs:
        given = (folder, Path(workdirs), now, judged, make, again)
        parts = [
            Part(
                case.name,
                now.entry(case),
                CASE_COST,
                measure_case,
                (case, *given),
            )
            for case in spread(cases)
        ]
        if not again:
            _import_ledger(kept, Journal(place), parts)
        measured = carry_out(
            parts, place, engine or Local(), meter or Meter(), again=again
        )
        for record in measured:
            entry = entry_of(named[record.key], now, record)
            if entry.state != "made" and kept.get(record.key) != entry:
                kept[record.key] = entry
                write_ledger(path, kept.values())
    return tuple(kept[case.name] for case in cases if case.name in kept)


def entry_of(case: Case, now: Sources, record: Record) -> Entry:
    """Ledger entry of `case` from its campaign record; a failed entry where it has no
    outcome.
    """
    if record.outcome is None:
        return Entry(
            case=case, of=now.entry(case), state="failed", reason=record.reason
        )
    return Entry.model_validate(record.outcome)


def _import_ledger(
    kept: Mapping[str, Entry], journal: Journal, parts: Sequence[Part]
) -> None:
    """Copy a ledger's outcomes into the journal, so that an exam can resume
    elsewhere.
    """
    for part in parts:
        entry = kept.get(part.key)
        if entry is None or (entry.state, entry.of) != ("scored", part.of):
            continue
        if not journal.get(part.key, part.of):
            outcome = entry.model_dump(mode="json")
            record = Record(
                schema=1, key=part.key, of=part.of, state="measured", outcome=outcome
            )
            journal.put(record)


def spread(cases: Sequence[Case]) -> list[Case]:
    """Cases in an order in which every kind is evenly distributed."""
    of_kind = Counter(case.kind for case in cases)
    seen: Counter[Kind] = Counter()
    places = []
    for case in cases:
        places.append((seen[case.kind] + 0.5) / of_kind[case.kind])
        seen[case.kind] += 1
    return [
        case for _, case in sorted(zip(places, cases, strict=True), key=itemgetter(0))
    ]


def summarise(record: Record) -> str:
    """Short text of a case's result, for the progress report."""
    if record.outcome is None:
        return f": failed: {record.reason}"
    scored = record.outcome["outcome"]
    return f": {scored['result'].replace('_', ' ')}" if scored else ": runs made"
