"""Study of verdicts of `cell gap` on mechanisms, of the exam or of other makers.

Without `--models` they are chains of two to seven joints and a pendulum on a cart. Its
folder is that of `pip install --no-deps --target FOLDER dm_control gymnasium robosuite
airo-models example-robot-data`, and `cases` in it are those of `../shared`.
"""

import os
import time
from collections.abc import Sequence
from itertools import chain
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from cell.gap.fit import FitOptions, fit
from cell.gap.fitting.base_fit import projection, stated_estimate
from cell.gap.fitting.gauss_newton import residuals
from cell.gap.open_subject import open_subject
from cell.gap.selection.screening import DETECTED_SIGMA
from cell.gap.subject.mechanism.effects import library
from cell.gap.subject.run_folders import find_runs
from cell.gap.verdict.schema import Verdict
from drivers.base.errors import ConfigurationError
from tests.lab.exam.mechanisms import LISTS, make_runs
from tests.lab.exam.score import claim
from tests.lab.exam.spoilt import FAULTS, NAMES, spoil
from tests.lab.studies.study import (
    Quantity,
    Statistic,
    Study,
    Values,
    percentage,
)

KINDS = ("nothing", "one effect", "two effects", "outside", "wrong base")
# variables of the environment that a study's processes share
FOLDER, SPOILT = "STUDY_MODELS", "STUDY_SPOILT"
DRIFTS = "changes from run to run"
REPEATED = 3  # times that each motion is made where a drift is to be told
RIGHT = {
    "wrong_mass": {"link_inertia"},
    "wrong_com": {"com_error"},  # of a wrong base
    "wrong_geometry": {"link_geometry"},
}
WITHHELD = 0.5  # of causes outside the library, those that are withheld from it


def draw(number: int, rng: np.random.Generator, drawn: int = 1) -> Values:
    """Draw what is hidden, a fifth of each kind; one effect again until it shows in its
    runs.
    """
    models = (
        LISTS["models"]
        if FOLDER in os.environ
        else {name: {} for name in LISTS["chains"]}
    )
    kind, block = KINDS[number % len(KINDS)], number // len(KINDS)
    spoilt = ""
    if SPOILT in os.environ and number % len(KINDS) == block % len(KINDS):
        kind, spoilt = (
            ("nothing", "one effect")[block % 2],
            list(FAULTS)[block % len(FAULTS)],
        )
    able = LISTS["chains"] if spoilt == "contact" else models
    name = str(
        rng.choice([n for n in able if not spoilt or "mode" not in models.get(n, {})])
    )
    known = models.get(name, {})
    mode = known.get("mode", "prescribed")
    count = {"nothing": 0, "two effects": 2}.get(kind, 1)
    library = LISTS["library"][mode] + ["base_compliance"] * ("sways" in known)
    withheld = kind == "outside" and bool(rng.random() < WITHHELD)
    others = {"outside": LISTS["outside"][mode], "wrong base": LISTS["wrong"]}
    causes = library if withheld else others.get(kind, library)
    hidden = [str(c) for c in rng.choice(causes, count, replace=False)]
    twins = [twin for h in hidden for twin in LISTS["twins"][mode].get(h, ())]
    case = {
        "kind": "spoilt" if spoilt else kind,
        "spoilt": spoilt,
        "model": name,
        "hidden": hidden,
        "drawn": drawn,
        "without": [*hidden, *twins] if withheld else [],
        "size": float(rng.uniform(0.8, 1.6)),
        "seed": int(rng.integers(2**31)),
    }
    shows = kind != "one effect" or power(case) >= DETECTED_SIGMA
    return case if shows else draw(number, rng, drawn + 1)


def measure(case: Values) -> Values:
    """Score the verdict on a case; also returns its processor time `cpu` [s]."""
    fault = case.get("spoilt", "")
    with TemporaryDirectory() as place:
        out = Path(place) / "model"
        file, runs = runs_of(case, out), [out / "study-runs"]
        began = time.process_time()
        if fault:
            spoil(out, file, fault, case["seed"])
        said = what_is_said(file, runs)
        verdict = None
        if "bad" not in said.values():
            options = FitOptions(without=case["without"])
            verdict = fit(runs, file, Path(place) / "out", options)
        cpu = time.process_time() - began
    if fault:
        scored = _score_spoilt(case, said, verdict)
    elif verdict is None:
        scored = fail(case)
    else:
        scored = _score_sound(case, verdict)
    return {**scored, "cpu": cpu, "said": said, **_facts(case, verdict)}


def what_is_said(file: Path, runs: Sequence[Path]) -> dict[str, str]:
    """Levels of the findings on recordings before a fit, by what they are called.

    A jump as a reading comes free is refused as the runs are read.
    """
    try:
        opened = open_subject(file, find_runs(runs), 1)
    except ConfigurationError as error:
        return {
            "stuck reading" if "stands still" in str(error) else "unreadable": "bad"
        }
    return {each.what: each.level for each in opened.contradictions()}


def _score_sound(case: Values, verdict: Verdict) -> Values:
    """Score of a verdict on sound recordings, with the `power` of what is hidden."""
    shows = power(case)
    scored = score(case["kind"], case["hidden"], verdict, shows >= DETECTED_SIGMA)
    return {**scored, case["kind"]: scored["by_class"], "power": shows}


def _score_spoilt(case: Values, said: Values, verdict: Verdict | None) -> Values:
    """Score of a spoilt recording: its fault `told` by its kind, and nothing named that
    neither this nor a hidden cause makes.
    """
    named = set() if verdict is None else {e.name for e in verdict.effects}
    told = case["spoilt"] in said or DRIFTS in str(verdict)
    false = bool(named - names_that_are_right(case))
    return {"by_class": told and not false, "false": false, "told": told, "base": None}


def _facts(case: Values, verdict: Verdict | None) -> Values:
    """What a verdict says, and what it claims; None of recordings that are refused.

    A class with a value of the file is right where the file is wrong.
    """
    if verdict is None:
        return {"verdict": "refused"}
    named, right = {e.name for e in verdict.effects}, names_that_are_right(case)
    suspected = [effect.name for effect in verdict.suspected]
    if case["kind"] == "wrong base":
        right |= {*chain(*verdict.ambiguous)}.difference(library())
    groups = [[name] for name in suspected] + verdict.ambiguous
    held = [named <= right] if named else [not right.isdisjoint(g) for g in groups]
    outside = bool(case["kind"] == "outside" or case["without"])
    number = str(case["seed"])
    return {
        "verdict": verdict.verdict,
        "ambiguous": verdict.ambiguous,
        "named": sorted(named),
        "deviates": [d.parameter for d in verdict.deviates],
        "suspected": suspected,
        "claim": claim(
            verdict, number, held, outside=outside, hides=bool(case["hidden"])
        ),
    }


def runs_of(case: Values, out: Path, noise: float = 1.0) -> Path:
    """File of the mechanism of a case, and its runs beside it, written to `out`."""
    home = Path(os.environ.get(FOLDER, ""))
    repeats = REPEATED if case.get("spoilt") == "drift" else 1
    return make_runs(
        home, case["model"], case["hidden"], case["size"], case["seed"], out, noise,
        repeats,
    )  # fmt: skip


def power(case: Values) -> float:
    """Distance [sigma] by which the hidden causes of a case move its noise-free runs.

    It is beyond what its model leaves with nothing hidden, and counts from
    DETECTED_SIGMA on.
    """
    moved, left = _distance(case), _distance({**case, "hidden": []})
    return float(np.sqrt(max(moved**2 - left**2, 0.0)))


def _distance(case: Values) -> float:
    """Distance [sigma] of the noise-free runs of a case from its model with the file's
    values.

    What a refit of the base takes up is counted by how far that carries it from the
    file, as the page counts what it calls detectable.
    """
    with TemporaryDirectory() as place:
        file = runs_of(case, Path(place), noise=0.0)
        subject = open_subject(file, find_runs([Path(place) / "study-runs"]), 1)
        stated = stated_estimate(subject, subject.simulate)
    moved = np.concatenate(residuals(stated.raw, stated.runs))
    return float(np.sqrt(moved @ projection(stated).unabsorbed(moved)))


def names_that_are_right(case: Values) -> set[str]:
    """Names of effects that count as right for what a case hides, or what spoils its
    recording; none for an outside cause.
    """
    if case["kind"] == "outside":
        return set()
    faults = NAMES.get(case.get("spoilt", ""), set())
    return {*case["hidden"], *faults}.union(*(RIGHT.get(h, ()) for h in case["hidden"]))


def score(
    kind: str, hidden: Sequence[str], verdict: Verdict, shown: bool = True
) -> dict[str, bool | None]:
    """Whether a verdict on `hidden` causes is right by class, names falsely, and tells
    a base.

    Right is no gap where nothing is hidden, unexplained where the library has no such
    cause, for a wrong base that its gap is told without a cause, if it is `shown` to be
    detectable.
    """
    named = {e.name for e in verdict.effects}
    every = named.union(*verdict.ambiguous)
    false = bool(named - names_that_are_right({"kind": kind, "hidden": hidden}))
    no_gap = verdict.verdict == "no_gap"
    told = not no_gap or bool(verdict.deviates)
    by_class = {
        "nothing": no_gap,
        "outside": verdict.verdict == "unexplained",
        "wrong base": (told or not shown) and not false,
    }.get(kind, set(hidden) <= every and not false)
    if kind == "outside":
        false = false or verdict.verdict == "ambiguous"
    base = told if kind == "wrong base" and shown else None
    return {"by_class": by_class, "false": false, "base": base}


def fail(case: Values) -> Values:
    """Score of a case that ends without a verdict: right in nothing."""
    base = False if case["kind"] == "wrong base" else None
    return {"by_class": False, "false": False, case["kind"]: False, "base": base}


STUDY = Study(
    name="mechanisms",
    question="What does `cell gap` say of causes hidden in mechanisms?",
    draw=draw,
    measure=measure,
    by=("kind",),
    quantities=(
        percentage("by_class", "right by class"),
        percentage("nothing", "no gap, least 97", 97.0),
        percentage("one effect", "one, least 90", 90.0),
        percentage("false", "false, most 2", 2.0, floor=False),
        percentage("told", "spoilt told, least 90", 90.0),
        percentage("base", "base told, least 80", 80.0),
        Quantity(
            "cpu", Statistic.MEDIAN, "s", 1.0, 30.0, label="median, most 30", digits=0
        ),
    ),
    failed=fail,
    usual=100,
    quick=1,
    seconds=60.0,
    limit=1200.0,
)
