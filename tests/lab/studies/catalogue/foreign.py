"""Study of what `cell gap` says of mechanisms that others modelled; `--models` holds their files.

The folder is that of `pip install --no-deps --target FOLDER dm_control gymnasium robosuite
airo-models example-robot-data`, and `cases` in it are those of `../shared`.
"""

import os
import time
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from cell.gap.fit import fit
from cell.gap.verdict.schema import Verdict
from tests.lab.exam.foreign import LISTS, make_runs
from tests.lab.studies.study import Quantity, Statistic, Study, Values

KINDS = ("nothing", "one effect", "two effects", "outside", "wrong base")
FOLDER = "FOREIGN_MODELS"  # variable of the environment that a study's processes share
RIGHT = {"wrong_mass": {"link_inertia"}}  # names that are right for a wrong base


def draw(number: int, rng: np.random.Generator) -> Values:
    """Draw what is hidden, a fifth of each kind, in one of the models."""
    kind = KINDS[number % len(KINDS)]
    name = str(rng.choice(list(LISTS["models"])))
    mode = LISTS["models"][name].get("mode", "prescribed")
    count = {"nothing": 0, "two effects": 2}.get(kind, 1)
    others = {"outside": LISTS["outside"][mode], "wrong base": LISTS["wrong"]}
    causes = others.get(kind, LISTS["library"][mode])
    hidden = [str(c) for c in rng.choice(causes, count, replace=False)]
    return {"kind": kind, "model": name, "hidden": hidden,
            "size": float(rng.uniform(0.8, 1.6)), "seed": int(rng.integers(2**31))}  # fmt: skip


def measure(case: Values) -> Values:
    """Score the verdict on a case; also returns its processor time `cpu` [s]."""
    folder = Path(os.environ.get(FOLDER, "models"))
    with TemporaryDirectory() as place:
        out = Path(place) / "model"
        file = make_runs(folder, case["model"], case["hidden"], case["size"], case["seed"], out)
        began = time.process_time()
        verdict = fit([out / "study-runs"], file, Path(place) / "out")
        cpu = time.process_time() - began
    return {**score(case["kind"], case["hidden"], verdict), "cpu": cpu,
            "verdict": verdict.verdict, "ambiguous": verdict.ambiguous,
            "named": {e.name: e.confidence for e in verdict.effects},
            "deviates": [d.parameter for d in verdict.deviates],
            "suspected": [e.name for e in verdict.suspected]}  # fmt: skip


def score(kind: str, hidden: Sequence[str], verdict: Verdict) -> dict[str, bool | None]:
    """Whether a verdict on `hidden` causes is right by class, names falsely, and tells a base.

    Right is no gap where nothing is hidden, unexplained where the library has no such cause, and
    for a wrong base that its gap is told without a cause. None where nothing is to be told.
    """
    named = {e.name for e in verdict.effects}
    every = named.union(*verdict.ambiguous)
    right = set[str](hidden).union(*(RIGHT.get(h, ()) for h in hidden))
    false = bool(named - right)
    told = verdict.verdict != "no_gap" or bool(verdict.deviates)
    by_class = {"nothing": verdict.verdict == "no_gap", "outside": verdict.verdict == "unexplained",
                "wrong base": told and not false}.get(
                    kind, set(hidden) <= every and not false)  # fmt: skip
    if kind == "outside":
        false = false or verdict.verdict == "ambiguous"
    base = told if kind == "wrong base" else None
    return {"by_class": by_class, "false": false, "base": base}


STUDY = Study(
    name="foreign",
    question="What does `cell gap` say of mechanisms that others modelled?",
    draw=draw,
    measure=measure,
    by=("kind",),
    quantities=(
        Quantity("by_class", Statistic.SHARE, "%", 100.0, label="right by class", digits=0),
        Quantity("false", Statistic.SHARE, "%", 100.0, label="named falsely", digits=0),
        Quantity("base", Statistic.SHARE, "%", 100.0, label="wrong base told", digits=0),
        Quantity("cpu", Statistic.MEDIAN, "s", 1.0, label="median time", digits=0),
    ),
    usual=100,
    quick=1,
    seconds=40.0,
)
