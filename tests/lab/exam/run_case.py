"""Examines one case: makes its runs, diagnoses them in a process apart, scores the verdict."""

import json
import shutil
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from cell.config.places import find_configs
from cell.gap.subject.run_folders import find_runs
from cell.gap.verdict.schema import Verdict, read_verdict
from drivers.errors import CellError, ConfigurationError
from drivers.files import replace_file
from drivers.strip.describe import load_strip
from tests.lab.exam.case import Case
from tests.lab.exam.cases import Sources, case_hash
from tests.lab.exam.diagnosis import NOTES, VERDICT_FILE, Effort, diagnose
from tests.lab.exam.ledger import Entry
from tests.lab.exam.score import Baselines, oracle, same, score

Steps = Literal["all", "make", "judge"]
Maker = Callable[[Case, Path], object]
RUNS_FOLDER, VERDICTS_FOLDER, STAMP, MADE = "runs", "verdicts", "diagnosed.json", "made"
CASE_COST = 60.0  # s of one core, about


def made_by_tier(case: Case, folder: Path) -> None:
    """Make the runs of `case` in `folder`, through images or from the state by its tier."""
    if case.tier == "images":
        from tests.lab.exam import through_images

        through_images.make_runs(case, folder)
        return
    from tests.lab.exam.from_state import make_runs

    make_runs(case, folder)


@dataclass(frozen=True, slots=True)
class ExamPart:
    """An exam case as a part of a campaign, with its ledger entry as outcome.

    Its runs and verdict lie in `folder`; diagnoses work within `workdirs`, or among the temporary
    files of a machine that has no such folder.
    """

    case: Case
    folder: Path
    workdirs: Path
    sources: Sources
    entry: str
    steps: Steps
    make: Maker
    again: bool = False
    cost: float = CASE_COST

    @property
    def key(self) -> str:
        """Name of the case."""
        return self.case.name

    @property
    def of(self) -> str:
        """Digest of engine, case and scorer, marked where the runs alone are made."""
        return self.entry + ("-made" if self.steps == "make" else "")

    def measure(self) -> Mapping[str, Any]:
        """Make the runs, diagnose them, score the verdict; raises CellError where a step fails."""
        case = self.case
        place = self.folder / RUNS_FOLDER / case.name
        if self.steps != "judge":
            keep_runs(case, place, self.make)
        if self.steps == "make":
            return Entry(case=case, of=self.entry, state="made").model_dump(mode="json")
        if read_stamp(place) != case_hash(case):
            reason = _stored_refusal(place, case) or "holds no runs of this case; make them first"
            raise ConfigurationError(f"{place}: {reason}")
        workdirs = self.workdirs if self.workdirs.is_dir() else None
        entry = judge(case, self.folder, self.sources, workdirs=workdirs, again=self.again)
        return entry.model_dump(mode="json")


def keep_runs(case: Case, place: Path, make: Maker) -> None:
    """Make the runs of `case` at `place`, unless those there belong to this very case."""
    if read_stamp(place) == case_hash(case):
        return
    scratch = place.with_name(place.name + ".part")
    for old in (scratch, place):
        shutil.rmtree(old, ignore_errors=True)
    scratch.mkdir(parents=True)
    try:
        make(case, scratch)
    except CellError as error:
        stored = {"case": case_hash(case), "reason": str(error)}
        replace_file(_refusal_file(place), json.dumps(stored).encode())
        raise
    (scratch / MADE).write_text(case_hash(case), encoding="utf-8")
    scratch.replace(place)


def _refusal_file(place: Path) -> Path:
    """Path of the file with the reason why the runs at `place` could not be made."""
    return place.with_name(place.name + ".refused.json")


def _stored_refusal(place: Path, case: Case) -> str | None:
    """Stored reason why the runs of this very case could not be made; None without one."""
    try:
        stored = json.loads(_refusal_file(place).read_text(encoding="utf-8"))
        return str(stored["reason"]) if stored["case"] == case_hash(case) else None
    except (OSError, ValueError, KeyError):
        return None


def read_stamp(place: Path) -> str | None:
    """Digest of the case to which the runs at `place` belong; None without runs."""
    try:
        return (place / MADE).read_text(encoding="utf-8")
    except OSError:
        return None


def judge(
    case: Case, folder: Path, by: Sources, *, workdirs: Path | None, again: bool = False
) -> Entry:
    """Diagnose and score the runs of `case`; reuses a stored verdict on it by the same engine."""
    strip = find_configs(None).strip_path(case.strip)
    runs, out = find_runs([folder / RUNS_FOLDER / case.name]), folder / VERDICTS_FOLDER / case.name
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
        case=case, of=by.entry(case), state="scored",
        outcome=score(verdict, case, load_strip(strip)),
        oracle=oracle(case, strip, runs, verdict.held_out) if case.answer else None,
        baselines=baselines(verdict, notes["tried"], case),
        wall=effort.wall, memory=effort.memory, spreads=notes.get("scatter", {}),
    )  # fmt: skip


def baselines(verdict: Verdict, tried: list[dict[str, Any]], case: Case) -> Baselines:
    """Baseline answer: the effect with least in-sample error; without fits, the first candidate."""
    singles = [model for model in tried if model["effects"] == 1]
    if singles:
        name = str(min(singles, key=lambda model: float(model["mean_square"]))["name"])
    else:
        rows = [row.name for row in verdict.candidates if " + " not in row.name]
        name = rows[0] if rows else ""
    return Baselines(single=name or None, right=same(name, case.answer))


def _stored_verdict(out: Path, of: str) -> Effort | None:
    """Effort of a stored verdict; None without a verdict that has the digest `of`."""
    try:
        facts = json.loads((out / STAMP).read_text(encoding="utf-8"))
        if facts["of"] == of:
            return Effort(facts["wall"], facts["memory"])
    except (OSError, ValueError, KeyError):
        pass
    return None
