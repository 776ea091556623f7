"""Whether the confidence of `cell gap` is earned, and its calibration: verdicts against the truth.

python -m tests.benchmarks.measure_confidence measure LEDGER --seed 7301 --cases 60
python -m tests.benchmarks.measure_confidence fit LEDGER...
python -m tests.benchmarks.measure_confidence judge LEDGER...

`measure` draws cases from the state, of one effect and now and then of two, makes their runs and
fits them. Of two in five the effect is withheld from the library, with what looks like it: whatever
is named is wrong. A line a case is kept in LEDGER: it goes on where it stopped. `fit` writes the
calibration of these verdicts into the package and says how well it does on those that it was not
fitted to; `judge` holds what the package states against verdicts, of an exam's ledger as well.
"""

import argparse
import hashlib
import sys
from collections.abc import Iterator, Sequence
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
from cell.exam.scoring.targets import shown
from cell.gap.fit import fit
from cell.gap.verdict.confidence import CALIBRATION, Calibration, Signs, Weight, calibration
from cell.record.documents import write_document
from cell.record.json_lines import Journal
from drivers.strip.describe import load_strip
from drivers.strip.effects import registry
from drivers.types import Array

PAIRS, WITHHELD = 8, (1, 3)  # one case in so many hides two; of five, these are withheld
FIFTHS = 5
RANGES = {  # within which a sign counts: beyond, a lead is "excluded" and a misfit a misfit
    "ahead": (0.0, 30.0),
    "left": (0.5, 2.0),
    "correlation": (0.0, 0.6),
    "closed": (0.0, 1.0),
}
FIRM = 2.0  # one sigma of the prior of what a sign weighs over its whole range [log-odds]
DOUBT = 1.5  # the same, of its mean, in the sense in which the sign speaks
SENSE = {"ahead": 1.0, "left": -1.0, "correlation": -1.0, "closed": 1.0}


class Name(NamedTuple):
    """A verdict that names: its signs, whether it is right, what it stated, and of which case."""

    signs: Signs
    right: bool
    withheld: bool
    case: str


def measure(ledger: Path, seed: int, cases: int, first: int) -> None:
    """Fit the cases that LEDGER does not hold."""
    kept, engine = Journal(ledger), sources().engine
    done = {line["outcome"]["case"] for line in kept.lines}
    for number in range(first, first + cases):
        case = drawn(seed, number)
        if case.name in done:
            continue
        line = {"of": engine, **_measured(case, withheld(case, number))}
        kept.append(line)
        sys.stdout.write(f"{said(line)}\n")
        sys.stdout.flush()


def drawn(seed: int, number: int) -> Case:
    """Case `number`: of one effect, or of two."""
    if number % PAIRS == PAIRS - 1:
        return Draw("state", "pair", number, number // PAIRS, seed).case()
    return Draw("state", "single", number, number, seed).case()


def withheld(case: Case, number: int) -> list[str]:
    """What the library lacks in a case: one hidden effect and what no run tells from it, or
    nothing.
    """
    if number % 5 not in WITHHELD:
        return []
    hidden = sorted(case.effects)[0]
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


def names(ledgers: Sequence[Path]) -> Iterator[Name]:
    """The verdicts with a name in ledgers, of this measurement or of an exam."""
    for path in ledgers:
        for line in Journal(path).lines:
            outcome, without = line.get("outcome"), line.get("without", [])
            if outcome and outcome["verdict"] == "named" and outcome.get("signs"):
                right = outcome["result"] in RIGHT and not without
                yield Name(Signs(**outcome["signs"]), right, bool(without), outcome["case"])


def fitted(found: Sequence[Name], source: str) -> Calibration:
    """The calibration that is most probable given these verdicts.

    Logistic regression with normal priors of what each sign weighs: few verdicts are wrong.
    """
    columns = np.array([_shares(name.signs) for name in found])
    right = np.array([name.right for name in found], dtype=float)
    prior = np.array([DOUBT * SENSE[sign] for sign in RANGES])

    def loss(x: Array) -> float:
        odds = x[0] + columns @ x[1:]
        nats = np.sum(np.logaddexp(0.0, odds) - right * odds)
        return float(nats + 0.5 * np.sum(((x[1:] - prior) / FIRM) ** 2))

    x = optimize.minimize(loss, np.zeros(1 + len(RANGES)), method="BFGS").x
    weights, intercept = {}, float(x[0])
    for (sign, (low, high)), value in zip(RANGES.items(), x[1:], strict=True):
        weights[sign] = Weight(weight=float(value) / (high - low), low=low, high=high)
        intercept -= float(value) * low / (high - low)
    return Calibration(intercept=intercept, weights=weights, source=source)


def _shares(seen: Signs) -> Array:
    """Where the signs lie within their ranges (k,), 0 to 1."""
    return np.array(
        [np.clip((getattr(seen, sign) - low) / (high - low), 0.0, 1.0)
         for sign, (low, high) in RANGES.items()]
    )  # fmt: skip


def left_out(found: Sequence[Name]) -> list[tuple[float, bool]]:
    """What the calibration of all other cases states of each verdict, and whether it is right."""
    stated = []
    for name in found:
        others = [other for other in found if other.case != name.case]
        stated.append((fitted(others, "-").probability(name.signs), name.right))
    return stated


def log_loss(stated: Sequence[tuple[float, bool]]) -> float:
    """Mean nats lost by stating these probabilities of these outcomes."""
    p = np.array([p if right else 1.0 - p for p, right in stated])
    return float(-np.mean(np.log(np.clip(p, 1e-9, 1.0))))


def reliable(stated: Sequence[tuple[float, bool]]) -> str:
    """The reliability table, in fifths of the stated probability, as Markdown."""
    rows = [
        (f"{b.confidence:.2f}", shown(b.right), f"{100 * (b.right.value - b.confidence):+.0f}")
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
    found = list(names(ledgers))
    stated = left_out(found)
    digest = hashlib.sha256(b"".join(path.read_bytes() for path in ledgers)).hexdigest()[:12]
    wrong = sum(not name.right for name in found)
    source = (
        f"{len(found)} verdicts that name, {wrong} of them wrong, "
        f"{sum(name.withheld for name in found)} with the effect withheld, of "
        f"{', '.join(path.name for path in ledgers)} (sha256 {digest}); left out one by one: "
        f"log loss {log_loss(stated):.3f} nats, calibration error in fifths "
        f"{calibration_error(stated, FIFTHS):.3f}"
    )
    write_document(CALIBRATION, fitted(found, source).model_dump())
    return f"{CALIBRATION}\n\nLeft out one by one:\n\n{reliable(stated)}"


def judge(ledgers: Sequence[Path]) -> str:
    """What the package states of the verdicts, by whether the effect was in the library."""
    found, by = list(names(ledgers)), calibration()
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
        measure(asked.ledgers[0], asked.seed, asked.cases, asked.first)
        return
    sys.stdout.write((calibrate if asked.what == "fit" else judge)(asked.ledgers) + "\n")


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("what", choices=("measure", "fit", "judge"))
    parser.add_argument("ledgers", type=Path, nargs="+")
    parser.add_argument("--seed", type=int, default=7301)
    parser.add_argument("--cases", type=int, default=60)
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    return parser.parse_args()


if __name__ == "__main__":
    main()
