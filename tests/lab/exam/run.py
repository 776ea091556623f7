"""An exam as a study: a case is drawn, its runs are judged in a process apart, the
verdict is scored.
"""

import os
import shutil
import subprocess
import sys
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from cell.base.config.places import find_configs
from cell.gap.subject.run_folders import find_runs
from cell.gap.verdict.fit_folder import VERDICT
from cell.gap.verdict.schema import Verdict, read_verdict
from drivers.base.child import THREADS
from drivers.base.errors import CellError
from drivers.base.settings import Settings
from drivers.strip.describe import load_strip
from tests.lab.exam import from_state, through_images
from tests.lab.exam.case import Case, Kind, Tier
from tests.lab.exam.cases import draw_case
from tests.lab.exam.score import Oracle, Outcome, oracle, score
from tests.lab.studies.study import Study, Values

ROOT = Path(__file__).resolve().parents[3]
# s; it ends what hangs: how long a fit may take has a bar of its own
TIME_LIMIT = 1800.0
CASE_TIMEOUT = 7200.0  # s of a case, runs through images included
MAKERS = {"state": from_state.make_runs, "images": through_images.make_runs}
KINDS: dict[Tier, tuple[Kind, ...]] = {
    "state": (
        *("nothing", "single", "pair", "single"),
        *("nothing", "single", "nothing", "single", "nothing", "single"),
    ),
    "images": (
        *("nothing", "single", "outside", "single"),
        *("pair", "single", "nothing", "outside", "single", "pair"),
    ),
}
"""Kinds of ten cases in a row, so that an exam that ends early has seen all of them."""


class NoVerdict(CellError):
    """Error of a diagnosis without verdict: it ran too long, died or refused its
    input.
    """


class Entry(Settings):
    """Line of a ledger: a case with its outcome, or the `reason` why there is none.

    `oracle` is None where nothing of the library is hidden.
    """

    case: Case
    outcome: Outcome | None = None
    oracle: Oracle | None = None
    reason: str = ""


def draw(number: int, rng: np.random.Generator, tier: Tier) -> Values:
    """Draw the kind of a case of the `tier`, its number within the kind, and its
    seed.
    """
    kinds = KINDS[tier]
    turn, place = divmod(number, len(kinds))
    kind = kinds[place]
    of_kind = turn * kinds.count(kind) + kinds[:place].count(kind)
    seed = int(rng.integers(2**31))
    return {"tier": tier, "kind": kind, "number": of_kind, "seed": seed}


def measure(values: Values) -> Values:
    """Ledger entry of the case that is drawn by `values`, as plain values."""
    case = draw_case(**values)
    with TemporaryDirectory(prefix="exam-") as place:
        MAKERS[case.tier](case, Path(place) / "runs")
        return judge(case, Path(place)).model_dump(mode="json")


def judge(case: Case, folder: Path) -> Entry:
    """Diagnose and score the runs of `case` in `folder`, which holds nothing else."""
    strip = find_configs(None).strip_path(case.strip)
    shutil.copyfile(strip, folder / "strip.yaml")
    try:
        verdict = diagnose(folder)
    except NoVerdict as error:
        return Entry(case=case, reason=str(error))
    runs = find_runs([folder / "runs"])
    return Entry(
        case=case,
        outcome=score(verdict, case, load_strip(strip)),
        oracle=oracle(case, strip, runs, verdict.held_out) if case.answer else None,
    )


def diagnose(folder: Path, limit: float = TIME_LIMIT) -> Verdict:
    """Verdict of `cell gap fit` on strip.yaml and runs/ of `folder`, where it is run.

    Raises NoVerdict after `limit` [s], and with the last line of output where the
    command failed.
    """
    words = "-P -m cell gap fit runs --strip strip.yaml --out out --jobs 1"
    environment = os.environ | dict.fromkeys(THREADS, "1") | {"PYTHONPATH": str(ROOT)}
    try:
        ended = subprocess.run(
            [sys.executable, *words.split()],
            cwd=folder,
            env=environment,
            timeout=limit,
            check=False,
            capture_output=True,
            text=True,
        )
    except subprocess.TimeoutExpired:
        raise NoVerdict(
            f"no verdict after {limit:.0f} s; the process was ended"
        ) from None
    if ended.returncode:
        *_, last = ["no output", *ended.stderr.strip().splitlines()]
        raise NoVerdict(f"the workflow ended with code {ended.returncode}: {last}")
    return read_verdict(folder / "out" / VERDICT)


def exam_of(tier: Tier, usual: int) -> Study:
    """Exam of a `tier` as a study of so many cases."""
    return Study(
        name=f"exam-{tier}",
        question="Does `cell gap` find what is hidden in a plant?",
        draw=partial(draw, tier=tier),
        measure=measure,
        quantities=(),
        usual=usual,
        quick=0,
        seconds=60.0,
        limit=CASE_TIMEOUT,
    )


EXAMS = {
    "small": exam_of("state", 6),
    "state": exam_of("state", 300),
    "images": exam_of("images", 90),
}
