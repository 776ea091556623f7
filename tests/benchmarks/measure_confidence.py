"""Whether the confidence of `cell gap` is earned, and its calibration: verdicts against the truth.

python -m tests.benchmarks.measure_confidence measure LEDGER --seed 7301 --cases 60
python -m tests.benchmarks.measure_confidence fit LEDGER...
python -m tests.benchmarks.measure_confidence judge LEDGER...

`measure` draws cases from the state, of one effect and now and then of two, makes their runs and
fits them. From two in five (`--withheld`) the effect is withheld, with what looks like it: whatever
is named is wrong. A line a case is kept in LEDGER: it goes on where it stopped. `fit` writes the
calibration of these verdicts into the package and says how well it does on those that it was not
fitted to; `judge` holds what the package states against verdicts, of an exam's ledger as well.
"""

import argparse
import hashlib
import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from scipy import optimize

from cell.config.places import find_configs
from cell.exam.case import Case
from cell.exam.cases.answer_key import sources
from cell.exam.cases.draw import Draw
from cell.exam.report.page import table
from cell.exam.runs.from_model import make_runs
from cell.exam.scoring.score import RIGHT, score
from cell.exam.scoring.statistics import brier, calibration_error, reliability
from cell.exam.scoring.targets import rate_text
from cell.gap.fit import fit
from cell.gap.verdict.confidence import CALIBRATION, Calibration, Signs, Weight, calibration
from cell.record.documents import write_document
from cell.record.json_lines import Journal
from drivers.strip.describe import load_strip
from drivers.strip.effects import registry
from drivers.types import Array

PAIRS = 8  # one case in so many hides two
FIFTHS, LACKING = 5, (1, 3)  # of five cases, those that lack the effect first
OUTSIDE = 0.2  # of the cases that a confidence speaks of: as in the exam through images
WEIGHTS = {  # what a sign may weigh, and where it counts; before the verdicts are seen
    "ahead": Weight(weight=3.0, low=0.0, high=200.0, by_order=True),
    "left": Weight(weight=-2.0, low=0.5, high=2.0),
    "correlation": Weight(weight=-2.0, low=0.0, high=0.6),
    "closed": Weight(weight=1.0, low=0.0, high=1.0),
}
FIRM = 2.0  # one sigma of what a sign weighs about that, in log-odds


class Name(NamedTuple):
    """A verdict that names: its signs, whether it is right, what it stated, and of which case."""

    signs: Signs
    right: bool
    withheld: bool
    case: str


def measure(asked: argparse.Namespace) -> None:
    """Fit the cases that LEDGER does not hold."""
    kept, engine = Journal(asked.ledgers[0]), sources().engine
    done = {line["outcome"]["case"] for line in kept.lines}
    for number in range(asked.first, asked.first + asked.cases):
        case = drawn(asked.seed, number)
        if case.name in done:
            continue
        line = {"of": engine, **_measured(case, withheld(case, number, asked.withheld))}
        kept.append(line)
        sys.stdout.write(f"{said(line)}\n")
        sys.stdout.flush()


def drawn(seed: int, number: int) -> Case:
    """Case `number`: of one effect, or of two."""
    if number % PAIRS == PAIRS - 1:
        return Draw("state", "pair", number, number // PAIRS, seed).case()
    return Draw("state", "single", number, number, seed).case()


def withheld(case: Case, number: int, many: int) -> list[str]:
    """What the library lacks in `many` cases of five: one hidden effect, or the one whose law the
    hidden one resembles, and what no run tells from it; nothing in the others.
    """
    if number % FIFTHS not in LACKING[:many]:
        return []
    hidden = sorted(case.effects or case.answer)[0]
    return sorted({hidden, *registry()[hidden].looks_like})


def _measured(case: Case, without: Sequence[str]) -> dict[str, Any]:
    strip = find_configs(None).strip_path(case.strip)
    with TemporaryDirectory() as name:
        place = Path(name)
        make_runs(case, place / "runs")
        verdict = fit([place / "runs"], strip, place / "out", jobs=1, without=without)
    return {
        "without": list(without),
        "outcome": score(verdict, case, load_strip(strip)).model_dump(mode="json"),
    }


def said(line: dict[str, Any]) -> str:
    """What came of a case, in a line."""
    o = line["outcome"]
    without = f" without {', '.join(line['without'])}" if line["without"] else ""
    named = ", ".join(o["named"]) or "nothing"
    return f"{o['case']}: {', '.join(o['hidden'])}{without}: {o['verdict']}, {named}: {o['result']}"


def names(ledgers: Sequence[Path]) -> tuple[list[Name], float]:
    """The verdicts with a name in ledgers, of this measurement or of an exam, and the share of all
    cases from which the effect was withheld.
    """
    lines = [line for path in ledgers for line in Journal(path).lines if line.get("outcome")]
    found = []
    for line in lines:
        outcome, without = line["outcome"], bool(line.get("without"))
        if outcome["verdict"] == "named" and outcome.get("signs"):
            right = outcome["result"] in RIGHT and not without
            found.append(Name(Signs(**outcome["signs"]), right, without, outcome["case"]))
    return found, sum(bool(line.get("without")) for line in lines) / len(lines)


def shares(found: Sequence[Name], without: float) -> Array:
    """What each verdict counts (n,), so that OUTSIDE of all cases lack the effect and not the share
    `without` that was withheld.
    """
    lacking, whole = OUTSIDE / without if without else 1.0, (1.0 - OUTSIDE) / (1.0 - without)
    return np.array([lacking if name.withheld else whole for name in found])


def fitted(found: Sequence[Name], counts: Array, source: str) -> Calibration:
    """The calibration that is most probable given these verdicts.

    Logistic regression with normal priors of what each sign weighs, for few verdicts are wrong; no
    sign speaks against its sense.
    """
    columns = np.array(
        [[w.share(getattr(name.signs, sign)) for sign, w in WEIGHTS.items()] for name in found]
    )
    right = np.array([name.right for name in found], dtype=float)
    prior = np.array([w.weight for w in WEIGHTS.values()])

    def loss(x: Array) -> float:
        odds = x[0] + columns @ x[1:]
        nats = counts @ (np.logaddexp(0.0, odds) - right * odds)
        return float(nats + 0.5 * np.sum(((x[1:] - prior) / FIRM) ** 2))

    speaks = [(0.0, None) if w.weight > 0.0 else (None, 0.0) for w in WEIGHTS.values()]
    begin = np.concatenate([[0.0], prior])
    best = optimize.minimize(loss, begin, method="L-BFGS-B", bounds=[(None, None), *speaks]).x
    intercept, *weights = best
    moved = {
        sign: w.model_copy(update={"weight": float(value)})
        for (sign, w), value in zip(WEIGHTS.items(), weights, strict=True)
    }
    return Calibration(intercept=float(intercept), weights=moved, source=source)


def left_out(found: Sequence[Name], counts: Array) -> list[tuple[float, bool]]:
    """What the calibration of all other cases states of each verdict, and whether it is right."""
    stated = []
    for name in found:
        kept = np.array([other.case != name.case for other in found])
        others = [other for other in found if other.case != name.case]
        by = fitted(others, counts[kept], "-")
        stated.append((by.probability(name.signs), name.right))
    return stated


def log_loss(stated: Sequence[tuple[float, bool]], counts: Array | None = None) -> float:
    """Mean nats lost by stating these probabilities of these outcomes, each as often as it counts
    (n,).
    """
    p = np.array([p if right else 1.0 - p for p, right in stated])
    return float(-np.average(np.log(np.clip(p, 1e-9, 1.0)), weights=counts))


def reliable(stated: Sequence[tuple[float, bool]]) -> str:
    """The reliability table, in fifths of the stated probability, as Markdown."""
    rows = [
        (f"{b.confidence:.2f}", rate_text(b.right), f"{100 * (b.right.value - b.confidence):+.0f}")
        for b in reliability(stated, FIFTHS)
    ]
    wrong = [p for p, right in stated if not right]
    low = sum(p < 0.7 for p in wrong)
    head = ["mean stated probability, by fifths", "right, by class", "points apart"]
    return (
        f"{table(head, rows)}\n\n{len(stated)} verdicts that name, {len(wrong)} of them wrong; "
        f"expected calibration error {calibration_error(stated, FIFTHS):.3f}, log loss "
        f"{log_loss(stated):.3f} nats, Brier score {brier(stated):.3f}; {low} of {len(wrong)} "
        "wrong names are stated under 0.7."
    )


def calibrate(ledgers: Sequence[Path]) -> str:
    """Write the calibration of all these verdicts; what it states of those that were left out."""
    found, without = names(ledgers)
    counts = shares(found, without)
    stated = left_out(found, counts)
    rate = float(np.average([name.right for name in found], weights=counts))
    plain = log_loss([(rate, name.right) for name in found], counts)
    digest = hashlib.sha256(b"".join(path.read_bytes() for path in ledgers)).hexdigest()[:12]
    source = (
        f"{len(found)} verdicts that name, {sum(not name.right for name in found)} of them wrong, "
        f"{sum(name.withheld for name in found)} with the effect withheld, counted as if that were "
        f"so in {100 * OUTSIDE:.0f} % of all cases; from {', '.join(p.name for p in ledgers)} "
        f"(sha256 {digest}). Left out one by one, log loss {log_loss(stated, counts):.3f} nats, "
        f"of one probability for all {plain:.3f}"
    )
    write_document(CALIBRATION, fitted(found, counts, source).model_dump())
    return f"{CALIBRATION}: {source}"


def judge(ledgers: Sequence[Path]) -> str:
    """What the package states of the verdicts, by whether the effect was in the library."""
    (found, _), by = names(ledgers), calibration()
    parts = []
    for words, kept in (("All", (False, True)), ("None withheld", (False,)), ("Withheld", (True,))):
        mine = [(by.probability(n.signs), n.right) for n in found if n.withheld in kept]
        if mine:
            parts.append(f"{words}:\n\n{reliable(mine)}")
    return "\n\n".join(parts)


def main() -> None:
    """Do what is asked, and print what came of it."""
    asked = _arguments()
    if asked.what == "measure":
        measure(asked)
        return
    sys.stdout.write((calibrate if asked.what == "fit" else judge)(asked.ledgers) + "\n")


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("what", choices=("measure", "fit", "judge"))
    parser.add_argument("ledgers", type=Path, nargs="+")
    parser.add_argument("--seed", type=int, default=7301)
    parser.add_argument("--cases", type=int, default=60)
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--withheld", type=int, default=2, help="of five cases, without the effect")
    return parser.parse_args()


if __name__ == "__main__":
    main()
