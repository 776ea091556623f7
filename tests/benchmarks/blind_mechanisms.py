"""Causes hidden in mechanisms of two to seven joints, found blind: an exam of `cell gap`.

`python -m tests.benchmarks.blind_mechanisms OUT [--count 120] [--seed 0]` appends a line of JSON a
case to OUT/cases.jsonl and prints shares; the same command goes on where it stopped.
"""

import argparse
import json
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from cell.gap.fit import fit
from cell.gap.verdict.schema import Verdict
from tests.support.hidden_mechanisms import OUTSIDE, make_runs

Values = Mapping[str, Any]

TURN = ("nothing", "dry_friction", "outside", "quadratic_damping", "cable_spring", "nothing",
        "tracked", "payload", "torque_constant", "outside", "armature", "read")  # fmt: skip
OTHERS = {"outside": OUTSIDE, "tracked": ("control_delay", "joint_elasticity"),
          "read": ("torque_bias", "encoder_bias")}  # fmt: skip


def draw(number: int, rng: np.random.Generator) -> Values:
    """The next cause, in a chain of two to seven joints or a pendulum on a cart."""
    turn, slot = divmod(number, len(TURN))
    name = TURN[slot]
    if name in OTHERS:
        seen = number // 6 if name == "outside" else turn
        name = OTHERS[name][seen % len(OTHERS[name])]
    kind = "tracked" if name in OTHERS["tracked"] else "outside" if name in OUTSIDE else name
    if kind not in ("tracked", "outside", "nothing"):
        kind = "effect"
    cart = bool(rng.random() < 0.2) and kind != "tracked"
    joints = 2 if cart else int(rng.integers(2, 5 if kind == "tracked" else 8))
    return {"kind": kind, "hidden": name, "joints": joints, "cart": cart,
            "size": float(rng.uniform(0.7, 1.5)), "seed": int(rng.integers(2**31))}  # fmt: skip


def measure(case: Values) -> Values:
    """What the verdict says of a case: `right`, by `class`, `wrong` names."""
    with TemporaryDirectory() as place:
        folder = Path(place)
        file = make_runs(folder, case["hidden"], case["joints"], case["size"], case["seed"],
                         cart=case["cart"])  # fmt: skip
        verdict = fit([folder / "runs"], file, folder / "out")
    return {**score(case["hidden"], verdict), "verdict": verdict.verdict,
            "named": [e.name for e in verdict.effects], "ambiguous": verdict.ambiguous}  # fmt: skip


def score(hidden: str, verdict: Verdict) -> dict[str, bool]:
    """Whether a verdict on what was `hidden` is right, right by class, or names what is not there.

    Where nothing is hidden, `no_gap` is right; causes outside the library are to be left open.
    """
    named = [e.name for e in verdict.effects]
    if hidden == "nothing":
        right = verdict.verdict == "no_gap"
        return {"right": right, "by_class": right, "wrong": bool(named)}
    if hidden in OUTSIDE:
        return {"right": not named, "by_class": not named, "wrong": bool(named)}
    others = [name for name in named if name != hidden]
    among = hidden in named or any(hidden in group for group in verdict.ambiguous)
    return {"right": named == [hidden] and not verdict.ambiguous,
            "by_class": among and not others, "wrong": bool(others)}  # fmt: skip


def shares(rows: Sequence[Values]) -> str:
    """How many cases of each kind were right, right by class, and named what is not there."""
    lines = []
    for kind in ("nothing", "effect", "tracked", "outside"):
        of = [row for row in rows if row["kind"] == kind]
        counts = {key: sum(row[key] for row in of) for key in ("right", "by_class", "wrong")}
        lines.append(f"{kind}: {len(of)} cases, {counts}")
    return "\n".join(lines)


def main() -> None:
    """Draw, make, fit, score, append, sum up."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--count", type=int, default=120)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    ledger = given.out / "cases.jsonl"
    rows = [json.loads(line) for line in ledger.read_text().splitlines()] if ledger.exists() else []
    for number in range(len(rows), given.count):
        case = draw(number, np.random.default_rng([given.seed, number]))
        began = time.process_time()
        row = {"case": number, **case, **measure(case)}
        row["processor"] = round(time.process_time() - began, 1)
        rows.append(row)
        with ledger.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")
        print(json.dumps(row), flush=True)
    print(shares(rows))


if __name__ == "__main__":
    main()
