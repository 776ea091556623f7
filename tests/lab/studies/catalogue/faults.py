"""Study of faults in every state of a fold: which monitor notices each, and how the
fold ends.
"""

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from cell.gap.rehearse import table
from tests.lab.faults.blow import FAULT_STATES, Blow, strike
from tests.lab.faults.faults import FAULTS
from tests.lab.studies.kit.folds import cached_calibration
from tests.lab.studies.study import (
    Ledger,
    Outcome,
    Quantity,
    Statistic,
    Study,
    Values,
    percentage,
)

SEEDS = 3
ACCEPTABLE_VERDICTS = ("stopped", "harmless")


def draw(number: int, _rng: np.random.Generator) -> Values:
    """Draw case `number`; cases go through all faults, then states, then seeds of the
    noise.
    """
    number, fault = divmod(number, len(FAULTS))
    seed, state = divmod(number, len(FAULT_STATES))
    return {"fault": list(FAULTS)[fault], "state": FAULT_STATES[state], "noise": seed}


def measure(case: Values) -> Values:
    """Result of a fold with an injected fault: times [s], distances [m], and the
    verdict on it.
    """
    blow = Blow(case["fault"], case["state"], case["noise"])
    with TemporaryDirectory() as place:
        came = dict(strike(blow, Path(place), cached_calibration()))
        for key in ("outcome", "message"):
            came[key] = str(came[key]).replace(place, "RUNS")
    struck = came["verdict"] != "not struck"
    return came | {
        "noticed": came["verdict"] in ACCEPTABLE_VERDICTS if struck else None
    }


def page(outcomes: Sequence[Outcome]) -> str:
    """Format the ledger: every fault's worst cases."""
    rows = []
    for fault in FAULTS:
        cases = [o for o in outcomes if o.case.values["fault"] == fault]
        rows += [_fault_row(fault, cases)] if cases else []
    text = table(["fault", "ended", "noticed by", "stop", "rest", "way"], rows)
    states = {o.case.values["state"] for o in outcomes}
    if missing := [state for state in FAULT_STATES if state not in states]:
        text += f"\n\n{len(outcomes)} cases; not measured yet: {', '.join(missing)}."
    return f"{PAGE_HEAD}\n{text}\n"


def _fault_row(fault: str, cases: Sequence[Outcome]) -> tuple[str, ...]:
    """Table row of one fault: verdicts, outcomes, worst times and distance."""

    def states(verdict: str) -> str:
        some = [
            str(o.case.values["state"]) for o in cases if o.values["verdict"] == verdict
        ]
        named = ", ".join(dict.fromkeys(some))
        return f"{verdict} {len(some)}" + (
            f" ({named})" if verdict == "undetected" else ""
        )

    stopped = [o for o in cases if o.values["verdict"] == "stopped"]
    verdicts = ", ".join(
        states(v) for v in dict.fromkeys(str(o.values["verdict"]) for o in cases)
    )
    outcomes = dict.fromkeys(str(o.values["outcome"]) for o in stopped)
    named = ", ".join(f"`{name}`" for name in outcomes) or "-"
    scales = {"stop": 1.0, "rest": 1.0, "distance": 1e3}
    worst = [_worst_text(stopped, key, scale) for key, scale in scales.items()]
    return fault, verdicts, named, *worst


def _worst_text(cases: Sequence[Outcome], key: str, scale: float) -> str:
    values = [float(o.values[key]) for o in cases if o.values.get(key) is not None]
    return f"{scale * max(values):.2f}" if values else "-"


PAGE_HEAD = """# Faults of a fold: how each ended

Every fault strikes a fold of the twin in every state, 0.25 s after the state began (at once in
TOUCHED and STOPPING). *Stopped*: by a named fault. *Harmless*: the fold went through, and its
displacement was measured within 3 mm of the truth, or it said that it did not fold. Worst of the
stopped cases: seconds from the fault to the stop command and to rest, millimetres on the way. A
policy that hangs costs time of the machine only: the simulated clock stands; on the wall clock a
turn ends after 1 s. The study allows a state 20 s and a turn 15 s; a cell has 60 s and 300 s unless
`monitors:` in `cell.yaml` says otherwise.
"""

STUDY = Study(
    name="faults",
    question=(
        "Which faults are noticed, by which monitor, and does the arm always come to"
        " rest?"
    ),
    draw=draw,
    measure=measure,
    by=("fault",),
    quantities=(
        *(
            percentage(name, bar=100.0)
            for name in ("noticed", "resting", "within", "whole")
        ),
        Quantity("stop", Statistic.WORST_SIZE, "s", 1.0, label="worst to the stop"),
        Quantity("rest", Statistic.WORST_SIZE, "s", 1.0, label="worst to rest"),
        Quantity("distance", Statistic.WORST_SIZE, label="worst way"),
    ),
    usual=SEEDS * len(FAULT_STATES) * len(FAULTS),
    quick=1,
    seconds=6.0,
    limit=600.0,
    ledger=Ledger("tests/lab/ledgers/faults.md", page),
)
