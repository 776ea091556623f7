"""Study of faults in every state of a fold: which monitor notices each, and how the fold ends."""

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from tests.lab.faults.blow import FAULT_STATES, Blow, strike
from tests.lab.faults.faults import FAULTS
from tests.lab.studies.kit.folds import cached_calibration
from tests.lab.studies.study import Ledger, Outcome, Quantity, Statistic, Study, Values

SEEDS = 3
ACCEPTABLE_VERDICTS = ("stopped", "harmless")


def draw(number: int, _rng: np.random.Generator) -> Values:
    """Draw case `number`; cases go through all faults, then states, then seeds of the noise."""
    number, fault = divmod(number, len(FAULTS))
    seed, state = divmod(number, len(FAULT_STATES))
    return {"fault": list(FAULTS)[fault], "state": FAULT_STATES[state], "noise": seed}


def measure(case: Values) -> Values:
    """Result of a fold with an injected fault: times [s], distances [m], and the verdict on it."""
    blow = Blow(case["fault"], case["state"], case["noise"])
    with TemporaryDirectory() as place:
        came = dict(strike(blow, Path(place), cached_calibration()))
        for key in ("outcome", "message"):
            came[key] = str(came[key]).replace(place, "RUNS")
    struck = came["verdict"] != "not struck"
    return came | {"noticed": came["verdict"] in ACCEPTABLE_VERDICTS if struck else None}


def page(outcomes: Sequence[Outcome]) -> str:
    """Format the runbook's page: what one sees with its remedy, then every fault's worst cases."""
    stopped = [o for o in outcomes if o.values["verdict"] == "stopped"]
    lines = [PAGE_HEAD, "| it says | for instance | it happened after | do |", "|---|---|---|---|"]
    for name in sorted({str(o.values["outcome"]) for o in stopped}):
        mine = [o for o in stopped if o.values["outcome"] == name]
        causes = "; ".join(sorted({str(o.case.values["fault"]) for o in mine}))
        message = str(mine[0].values["message"]).splitlines()[0][:120]
        after = causes if name != "interrupted" else "Ctrl-C or a signal"
        lines.append(f"| `{name}` | {message} | {after} | {_remedy(name)} |")
    lines += [FAULTS_HEAD, "| fault | ended | noticed by | stop | rest | way |"]
    lines.append("|---|---|---|---|---|---|")
    for fault in FAULTS:
        cases = [o for o in outcomes if o.case.values["fault"] == fault]
        lines += [_fault_row(fault, cases)] if cases else []
    states = {o.case.values["state"] for o in outcomes}
    if missing := [state for state in FAULT_STATES if state not in states]:
        lines += ["", f"{len(outcomes)} cases; not measured yet: {', '.join(missing)}."]
    return "\n".join([*lines, ""])


def _fault_row(fault: str, cases: Sequence[Outcome]) -> str:
    """Table row of one fault: verdicts, outcomes, worst times and distance."""

    def states(verdict: str) -> str:
        some = [str(o.case.values["state"]) for o in cases if o.values["verdict"] == verdict]
        named = ", ".join(dict.fromkeys(some))
        return f"{verdict} {len(some)}" + (f" ({named})" if verdict == "undetected" else "")

    stopped = [o for o in cases if o.values["verdict"] == "stopped"]
    verdicts = ", ".join(states(v) for v in dict.fromkeys(str(o.values["verdict"]) for o in cases))
    outcomes = dict.fromkeys(str(o.values["outcome"]) for o in stopped)
    named = ", ".join(f"`{name}`" for name in outcomes) or "-"
    worst = [
        _worst_text(stopped, key, scale)
        for key, scale in (("stop", 1), ("rest", 1), ("distance", 1e3))
    ]
    return f"| {fault} | {verdicts} | {named} | {' | '.join(worst)} |"


def _remedy(outcome: str) -> str:
    """The operator's action after a run with this outcome."""
    return next(words for begin, words in REMEDIES if outcome.startswith(begin))


def _worst_text(cases: Sequence[Outcome], key: str, scale: float) -> str:
    values = [float(o.values[key]) for o in cases if o.values.get(key) is not None]
    return f"{scale * max(values):.2f}" if values else "-"


REMEDIES = (
    ("camera_moved", "fasten the camera, calibrate again"),
    ("image", "see [camera](camera-frozen-or-moved.md)"),
    (
        "low_confidence",
        "look at the last pictures of the record: light, exposure, something in the way",
    ),
    ("preflight", "do what the message says: it names the check and its remedy"),
    ("arm_pose", "keep the record; look at the robot's log before it moves again"),
    ("arm_state", "find what else computes on this machine: `cell doctor`"),
    ("setpoint", "find what else computes on this machine: `cell doctor`"),
    ("arm_", "see [recovery](reflex-recovery.md): look, then `cell home --recover`"),
    ("hand_state", "check the hand in Desk and the network; then `cell open`, in air"),
    ("motion", "see [recovery](reflex-recovery.md): look, then `cell home --recover`"),
    ("tracking", "look what holds the arm; check load and tool: `cell doctor`"),
    ("overspeed", "keep the record; check robot and limits: `cell doctor`"),
    ("workspace", "`cell home`, by eye; check the place of robot and desk in cell.yaml"),
    ("force", "look what presses on the gripper, free it, then `cell home`"),
    ("gr", "lay the strip anew; look at the fingers"),
    ("state_overtime", "look what the cell waits for: the hand, most often, or a camera"),
    ("command", "fold with another policy; keep the record"),
    ("turn", "fold with another policy; keep the record"),
    ("record", "make room on the disk"),
    ("simulation", "report the plant: only a twin ends so"),
    ("interrupted", "nothing: it was asked for"),
    ("", "keep the record, and say what happened"),
)
PAGE_HEAD = """# Faults, by what one sees

After a stop: see that the arm stands and that nobody moves it, read the message, then do what its
line says. Nothing on this page was tried on hardware; `python -m tests.lab study faults` measures
it on the twin.
"""
FAULTS_HEAD = """
## What was tried

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
    usual=SEEDS * len(FAULT_STATES) * len(FAULTS),
    quick=1,
    seconds=6.0,
    limit=600.0,
    ledger=Ledger("runbooks/faults.md", page),
)
