"""The campaign of faults: every one in every state of a fold, who notices it, and how it ends."""

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from cell.folding.blow import STATES, Blow, strike
from cell.folding.faults import FAULTS
from cell.report.statistic import Quantity, Statistic
from cell.studies.kit.folds import cached_calibration
from cell.studies.study import Ledger, Outcome, Study, Values

SEEDS = 3
GOOD = ("stopped", "harmless")


def draw(number: int, _rng: np.random.Generator) -> Values:
    """Every fault in a state, then in the next state, then all of it with the next noise."""
    number, fault = divmod(number, len(FAULTS))
    seed, state = divmod(number, len(STATES))
    return {"fault": list(FAULTS)[fault], "state": STATES[state], "noise": seed}


def measure(case: Values) -> Values:
    """What came of the fault; times [s], ways [m], shares as 0 and 1."""
    blow = Blow(case["fault"], case["state"], case["noise"])
    with TemporaryDirectory() as place:
        came = dict(strike(blow, Path(place), cached_calibration()))
        for key in ("outcome", "message"):
            came[key] = str(came[key]).replace(place, "RUNS")
    struck = came["verdict"] != "not struck"
    return came | {"noticed": came["verdict"] in GOOD if struck else None}


def page(outcomes: Sequence[Outcome]) -> str:
    """The runbook's table: a row a fault, with its worst case; then a row a monitor."""
    lines = [HEAD, "| fault | verdicts | noticed by | exit | stop | rest | way | message |"]
    lines.append("|---|---|---|---|---|---|---|---|")
    for fault in FAULTS:
        cases = [o for o in outcomes if o.case.values["fault"] == fault]
        lines += [_row(fault, cases)] if cases else []
    lines += ["", "| stopped by | cases | faults |", "|---|---|---|"]
    found = [o for o in outcomes if o.values["verdict"] == "stopped"]
    for name in sorted({str(o.values["outcome"]) for o in found}):
        mine = [o for o in found if o.values["outcome"] == name]
        causes = "; ".join(sorted({str(o.case.values["fault"]) for o in mine}))
        lines.append(f"| `{name}` | {len(mine)} | {causes} |")
    return "\n".join([*lines, ""])


def _row(fault: str, cases: Sequence[Outcome]) -> str:
    def states(verdict: str) -> str:
        some = [str(o.case.values["state"]) for o in cases if o.values["verdict"] == verdict]
        named = ", ".join(dict.fromkeys(some))
        return f"{verdict} {len(some)}" + (f" ({named})" if verdict == "undetected" else "")

    stopped = [o for o in cases if o.values["verdict"] == "stopped"]
    verdicts = ", ".join(states(v) for v in dict.fromkeys(str(o.values["verdict"]) for o in cases))
    named = ", ".join(dict.fromkeys(f"`{o.values['outcome']}`" for o in stopped)) or "-"
    codes = ", ".join(sorted({str(o.values["exit_code"]) for o in cases}))
    worst = [
        _worst(stopped, key, scale) for key, scale in (("stop", 1), ("rest", 1), ("distance", 1e3))
    ]
    said = str((stopped or cases)[0].values["message"]).splitlines()[0]
    return f"| {fault} | {verdicts} | {named} | {codes} | {' | '.join(worst)} | {said[:120]} |"


def _worst(cases: Sequence[Outcome], key: str, scale: float) -> str:
    values = [float(o.values[key]) for o in cases if o.values.get(key) is not None]
    return f"{scale * max(values):.2f}" if values else "-"


HEAD = """# Faults, and who notices them
Every fault strikes a fold of the twin in every state, 0.25 s after the state began (at once in
TOUCHED and STOPPING). *Stopped*: by a named fault, with exit code 2 to 130. *Harmless*: the fold
went through, and its displacement was measured within 3 mm of the truth, or it said that it did not
fold. *Not struck*: the state never came. Worst of the stopped cases: seconds from the fault to the
stop command and to rest, millimetres on the way. `cell study faults` writes this page. Nothing of
it was tried on hardware.
"""

STUDY = Study(
    name="faults",
    question="Which faults are noticed, by which monitor, and does the arm always come to rest?",
    draw=draw,
    measure=measure,
    by=("fault",),
    quantities=(
        Quantity("noticed", Statistic.SHARE, "%", 100.0, bar=100.0, floor=True, digits=0),
        Quantity("resting", Statistic.SHARE, "%", 100.0, bar=100.0, floor=True, digits=0),
        Quantity("within", Statistic.SHARE, "%", 100.0, bar=100.0, floor=True, digits=0),
        Quantity("whole", Statistic.SHARE, "%", 100.0, bar=100.0, floor=True, digits=0),
        Quantity("stop", Statistic.WORST_SIZE, "s", 1.0, label="worst to the stop"),
        Quantity("rest", Statistic.WORST_SIZE, "s", 1.0, label="worst to rest"),
        Quantity("distance", Statistic.WORST_SIZE, label="worst way"),
    ),
    usual=SEEDS * len(STATES) * len(FAULTS),
    quick=1,
    seconds=6.0,
    limit=600.0,
    ledger=Ledger("runbooks/faults.md", page),
)
