"""An exam carried out: keys sealed, runs made, verdicts sealed off, scores in the ledger."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from operator import itemgetter
from pathlib import Path
from tempfile import TemporaryDirectory

from cell.exam.case import Case, Kind
from cell.exam.cases.answer_key import seal, sources
from cell.exam.progress import Progress, quiet
from cell.exam.run_case import Examined, Maker, Steps, failed, made_by_tier
from cell.exam.scoring.results import Entry, Ledger
from cell.parallel import Refusal, run

LEDGER = "ledger.jsonl"


def run_exam(
    cases: Sequence[Case],
    folder: Path,
    *,
    jobs: int = 1,
    progress: Progress = quiet,
    interrupted: Callable[[], bool] = lambda: False,
    steps: Steps = "all",
    again: bool = False,
    make: Maker = made_by_tier,
    ledger: Path | None = None,
) -> tuple[Entry, ...]:
    """The entries of `cases`, `jobs` of them side by side in processes; kept in `folder`, and in
    the file `ledger` if there is one.

    What is scored already, by the same engine and scorer, is skipped, and runs are kept while
    their case stays the same; `again` judges anew. A case that fails is an entry with its
    reason, tried again at the next start. No case begins once `interrupted`; from the keyboard
    all end at once (KeyboardInterrupt), and what is finished is kept. Kinds are carried out side
    by side, so that an exam that ends early has seen all of them.
    """
    kept, now = Ledger(ledger or folder / LEDGER), sources()
    for case in cases:
        seal(case, folder)
    anew = again or steps == "make"
    left = [c for c in cases if anew or not kept.finished(c.name, now.entry(c))]
    named = {case.name: case for case in left}
    total, done = len(cases), len(cases) - len(left)
    progress(done, total, "")
    with TemporaryDirectory(prefix="exam-", ignore_cleanup_errors=True) as workdirs:
        parts = [
            Examined(case.name, folder, Path(workdirs), now, steps, make, again)
            for case in spread(left)
        ]
        for name, result in _carried_out(parts, jobs):
            case = named[name]
            entry = failed(case, now.entry(case), result) if isinstance(result, str) else result
            if entry.state != "made":
                kept.put(entry)
            done += 1
            progress(done, total, f"{name}: {said(entry)}")
            if interrupted():
                break
    return kept.of(cases)


def spread(cases: Sequence[Case]) -> list[Case]:
    """The cases in an order in which every kind is spread evenly over the whole."""
    of_kind = Counter(case.kind for case in cases)
    seen: Counter[Kind] = Counter()
    places = []
    for case in cases:
        places.append((seen[case.kind] + 0.5) / of_kind[case.kind])
        seen[case.kind] += 1
    return [case for _, case in sorted(zip(places, cases, strict=True), key=itemgetter(0))]


def said(entry: Entry) -> str:
    """What came of a case, in a few words."""
    if entry.outcome is None:
        return "runs made" if entry.state == "made" else f"failed: {entry.reason}"
    return entry.outcome.result.replace("_", " ")


def _carried_out(parts: Sequence[Examined], jobs: int) -> Iterator[tuple[str, Entry | str]]:
    """Names and entries as they finish; words where a process died."""
    for part, result in run(parts, jobs, _measure):
        yield part.key, result.reason if isinstance(result, Refusal) else result


def _measure(part: Examined) -> Entry:
    return part.measure()
