"""Study of how well `cell gap` finds causes hidden in mechanisms of two to seven joints."""

import time
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from cell.gap.fit import fit
from cell.gap.verdict.schema import Verdict
from tests.lab.exam.mechanisms import OUTSIDE, TRACKED, amounts, make_runs
from tests.lab.exam.score import signs
from tests.lab.studies.catalogue import foreign
from tests.lab.studies.study import Quantity, Statistic, Study, Values

CAUSE_CYCLE = ("nothing", "dry_friction", "outside", "quadratic_damping", "cable_spring", "nothing",
        "tracked", "payload", "torque_constant", "outside", "armature", "read")  # fmt: skip
CART_SHARE = 0.2  # of the cases that can stand on a cart
OTHER_CAUSES = {"outside": OUTSIDE, "tracked": TRACKED, "read": ("torque_bias", "encoder_bias")}


def draw(number: int, rng: np.random.Generator) -> Values:
    """Draw the next cause, in a chain of two to seven joints or a pendulum on a cart."""
    turn, slot = divmod(number, len(CAUSE_CYCLE))
    name = CAUSE_CYCLE[slot]
    if name in OTHER_CAUSES:
        before = number // (len(CAUSE_CYCLE) // 2) if name == "outside" else turn  # twice a cycle
        name = OTHER_CAUSES[name][before % len(OTHER_CAUSES[name])]
    kind = "tracked" if name in TRACKED else "outside" if name in OUTSIDE else "effect"
    kind = "nothing" if name == "nothing" else kind
    cart = bool(rng.random() < CART_SHARE) and kind != "tracked" and name != "bent_link"
    joints = 2 if cart else int(rng.integers(2, 5 if kind == "tracked" else 8))
    return {"kind": kind, "hidden": name, "joints": joints, "cart": cart,
            "size": float(rng.uniform(0.7, 1.5)), "seed": int(rng.integers(2**31))}  # fmt: skip


def measure(case: Values) -> Values:
    """Score the verdict on a case; also returns its processor time `cpu` [s].

    `covered` states for each known size whether its interval contains it.
    """
    hidden, joints, size, cart = (case[k] for k in ("hidden", "joints", "size", "cart"))
    with TemporaryDirectory() as place:
        folder = Path(place)
        file = make_runs(folder, hidden, joints, size, case["seed"], cart=cart)
        began = time.process_time()
        verdict = fit([folder / "runs"], file, folder / "out")
        cpu = time.process_time() - began
    truth = amounts(hidden, joints, size, cart=cart)
    return {**score(hidden, verdict), "covered": coverage(hidden, truth, verdict), "cpu": cpu,
            "verdict": verdict.verdict, "named": [e.name for e in verdict.effects],
            "ambiguous": verdict.ambiguous, "suspected": [e.name for e in verdict.suspected],
            "signs": signs(verdict)}  # fmt: skip


def score(hidden: str, verdict: Verdict) -> dict[str, bool | None]:
    """Whether a verdict on the `hidden` cause is right, right by class, or names a false effect."""
    kind = "outside" if hidden in OUTSIDE else "nothing" if hidden == "nothing" else "one effect"
    found = foreign.score(kind, [hidden], verdict)
    alone = [e.name for e in verdict.effects] == [hidden] and not verdict.ambiguous
    right = found["by_class"] and (alone or kind != "one effect")
    return {"right": right, "by_class": found["by_class"], "wrong": found["false"]}


def coverage(hidden: str, truth: Mapping[str, float], verdict: Verdict) -> list[bool]:
    """Whether the interval of each known size of a `hidden` effect contains the `truth`."""
    found = next((e.parameters for e in verdict.effects if e.name == hidden), {})
    return [(p.low is None or p.low <= truth[name]) and (p.high is None or truth[name] <= p.high)
            for name, p in found.items() if name in truth]  # fmt: skip


STUDY = Study(
    name="mechanisms",
    question="Which causes hidden in mechanisms of two to seven joints does `cell gap` name?",
    draw=draw,
    measure=measure,
    by=("kind",),
    quantities=(
        Quantity("right", Statistic.SHARE, "%", 100.0, label="right", digits=0),
        Quantity("by_class", Statistic.SHARE, "%", 100.0, label="right by class", digits=0),
        Quantity("wrong", Statistic.SHARE, "%", 100.0, label="wrong names", digits=0),
        Quantity("covered", Statistic.SHARE, "%", 100.0, label="sizes held", digits=0),
        Quantity("cpu", Statistic.MEDIAN, "s", 1.0, label="median time", digits=0),
        Quantity("cpu", Statistic.WORST_SIZE, "s", 1.0, label="longest time", digits=0),
    ),
    usual=120,
    quick=1,
    seconds=60.0,
)
