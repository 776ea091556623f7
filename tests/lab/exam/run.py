"""An exam as a study: a case is drawn, its runs are judged in a process apart, the
verdict is scored.
"""

import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from cell.base.config.places import find_configs
from cell.gap.verdict.fit_folder import VERDICT
from cell.gap.verdict.schema import Verdict, read_verdict
from drivers.base.child import THREADS
from drivers.base.errors import CellError
from drivers.base.readers import read_yaml
from drivers.strip.describe import load_strip
from tests.lab.exam import from_state, through_images
from tests.lab.exam.case import Case, Kind, Tier
from tests.lab.exam.cases import draw_case
from tests.lab.exam.score import RIGHT_RESULTS, Outcome, claim_on, score
from tests.lab.studies.study import Quantity, Statistic, Study, Values, percentage

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
    """Case that is drawn by `values`, its score, and the `reason` where it has none."""
    case = draw_case(**values)
    with TemporaryDirectory(prefix="exam-") as place:
        MAKERS[case.tier](case, Path(place) / "runs")
        return judge(case, Path(place))


def judge(case: Case, folder: Path, without: Sequence[str] = ()) -> Values:
    """Diagnose and score the runs of `case` in `folder`, which holds nothing else;
    `without` are effects withheld from the library.
    """
    strip = find_configs(None).strip_path(case.strip)
    shutil.copyfile(strip, folder / "strip.yaml")
    known: dict[str, Any] = {"case": case.model_dump(mode="json")}
    try:
        verdict = diagnose(folder, without)
    except NoVerdict as error:
        return {**known, "outcome": None, "reason": str(error), **facts(case)}
    scored = score(verdict, case, load_strip(strip))
    known |= {"outcome": scored.model_dump(mode="json"), **facts(case, scored)}
    return known | {"claim": claim_on(verdict, case, withheld=bool(without))}


def facts(case: Case, found: Outcome | None = None) -> dict[str, Any]:
    """What the table counts of a case, None where that was not asked."""
    result = found.result if found else "failed"
    clear, single = case.strength in ("medium", "strong"), case.kind == "single"
    quiet, pair = case.kind == "nothing" and found is not None, case.kind == "pair"

    def told(asked: bool, *good: str) -> bool | None:
        return result in good if asked else None

    compared = (*found.base, *found.parameters) if found else ()
    return {
        "plant": case.plant,
        "no gap": told(quiet, "correct_no_gap"),
        "alarm": told(quiet, "false_alarm"),
        "claimed": told(quiet, "false_alarm", "gap_claimed"),
        "strict": told(single and clear, "right_strict"),
        "by class": told(single and clear, *RIGHT_RESULTS),
        "one of two": told(pair, *RIGHT_RESULTS, "partly"),
        "both": told(pair, *RIGHT_RESULTS),
        "alike": told(case.plant == "another law" and clear, *RIGHT_RESULTS),
        "weak misnamed": told(single and not clear, "wrong_name"),
        "left open": told(case.kind == "outside", "correct_abstention"),
        "covered": [c.covered for c in compared],
        "amount off": [c.error for c in compared if c.switch],
        "runtime": found and found.runtime,
    }


def diagnose(
    folder: Path, without: Sequence[str] = (), limit: float = TIME_LIMIT
) -> Verdict:
    """Verdict of `cell gap fit` on strip.yaml and runs/ of `folder`, where it is run.

    Raises NoVerdict after `limit` [s], and with the last line of output where the
    command failed.
    """
    words = [
        "-P",
        "-m",
        "cell",
        "gap",
        "fit",
        "runs",
        "--strip",
        "strip.yaml",
        "--out",
        "out",
        "--jobs",
        "1",
    ]
    words += [f"--without={name}" for name in without]
    environment = os.environ | dict.fromkeys(THREADS, "1") | {"PYTHONPATH": str(ROOT)}
    try:
        ended = subprocess.run(
            [sys.executable, *words],
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


BARS: dict[str, list[float]] = read_yaml(Path(__file__).with_name("bars.yaml"))


def quantities(tier: Tier) -> tuple[Quantity, ...]:
    """Columns of the table of an exam: rates [%] with the least or the most of them."""
    quiet, alarm, strict, named, one, both, alike, weak, left, held, usual, most = BARS[
        tier
    ]
    return (
        percentage("no gap", "nothing hidden: no gap", quiet),
        replace(
            percentage("alarm", "an effect named there", alarm, floor=False),
            end=8.0 if tier == "state" else np.inf,
        ),
        percentage("claimed", "a gap claimed there"),
        percentage("strict", "one, medium or strong: named", strict),
        percentage("by class", "in the class", named),
        percentage("one of two", "two: one at least, none false", one),
        percentage("both", "both", both),
        percentage("alike", "laws that only resemble: in the class", alike),
        percentage("weak misnamed", "weak: misnamed", weak, floor=False),
        percentage("left open", "outside the library: left open", left),
        percentage("covered", "intervals that hold the truth", held),
        percentage("covered", "at most", 98.0, floor=False),
        Quantity("amount off", Statistic.MEDIAN, "%", 100.0, 25.0, digits=0),
        Quantity("runtime", Statistic.MEDIAN, "s", 1.0, usual, label="time, median"),
        Quantity("runtime", Statistic.WORST_SIZE, "s", 1.0, most, label="longest"),
    )


def exam_of(tier: Tier, usual: int) -> Study:
    """Exam of a `tier` as a study of so many cases."""
    return Study(
        name=f"exam-{tier}",
        question="Does `cell gap` find what is hidden in a plant?",
        draw=partial(draw, tier=tier),
        measure=measure,
        quantities=quantities(tier),
        by=("plant",),
        usual=usual,
        quick=0,
        seconds=60.0,
        limit=CASE_TIMEOUT,
        command=f"exam --tier {tier} --seed {{seed}} --cases {{count}}",
    )


EXAMS = {
    "small": exam_of("state", 6),
    "state": exam_of("state", 300),
    "images": exam_of("images", 90),
}
