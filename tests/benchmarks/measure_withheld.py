"""Withholds from the library what an exam's cases hide, and tells whether a law is offered.

python -m tests.benchmarks.measure_withheld EXAM [--cases 4] [--skip 0] [--nothing 1]
    [--repeats 1] [--jobs 1]

EXAM is the folder of an exam from the state. Of the cases that hide a single effect of medium
strength or more, so many are fitted without it and without what looks like it; so many that hide
nothing are fitted as they are. With --repeats the runs are made anew, each motion so many times:
then one of the taut lifts is held out.
"""

import argparse
import json
import sys
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np

from cell.config.places import find_configs
from cell.exam.case import Case
from cell.exam.cases.answer_key import KEYS, opened
from cell.exam.runs.from_model import make_runs
from cell.gap.fit import fit
from cell.gap.verdict.accept import RECORD
from cell.gap.verdict.offered_law import OFFER
from drivers.strip.effects import registry


class Outcome(NamedTuple):
    """What was said of a case that hides `effect`: the `shrink` by an offered law, None without
    one; whether other effects were `named`; the excess `gap` on held-out runs, and the share of it
    that what was named `closed`.
    """

    effect: str
    shrink: float | None
    named: bool
    gap: float
    closed: float


def main() -> int:
    """Fit, and tell case by case; 1 where a law is offered though nothing is hidden."""
    asked = _arguments()
    whole = [opened(asked.exam, path.stem) for path in sorted((asked.exam / KEYS).glob("*.yaml"))]
    made = [case for case in whole if (asked.exam / "runs" / case.name).is_dir()]
    hidden = [c for c in made if c.kind == "single" and c.alike and c.strength != "weak"]
    empty = [c for c in made if c.kind == "nothing"]
    some = hidden[asked.skip : asked.skip + asked.cases]
    found = [_told(case, asked) for case in some]
    _by_effect(found)
    _summed(found)
    false = [_told(case, asked).shrink is not None for case in empty[: asked.nothing]]
    sys.stdout.write(f"offered where nothing is hidden in {sum(false)} of {len(false)}\n")
    return int(any(false))


def _by_effect(found: Sequence[Outcome]) -> None:
    """A line an effect: how often a law was offered, and what was said else."""
    each: dict[str, list[Outcome]] = defaultdict(list)
    for outcome in found:
        each[outcome.effect].append(outcome)
    for effect, own in sorted(each.items()):
        offered = sum(o.shrink is not None for o in own)
        closed = [f"{100 * o.closed:.0f} %" for o in own if o.shrink is None and o.named]
        others = f", others named that close {', '.join(closed)}" if closed else ""
        sys.stdout.write(f"  {effect}: offered in {offered} of {len(own)}{others}\n")


def _summed(found: Sequence[Outcome]) -> None:
    shrinks = [f.shrink for f in found if f.shrink is not None]
    median = f"{100 * np.median(shrinks):.0f} %" if shrinks else "-"
    without = [f for f in found if f.shrink is None]
    named = sum(f.named for f in without)
    blind = sum(f.gap < OFFER.nothing and not f.named for f in without)
    sys.stdout.write(
        f"offered in {len(shrinks)} of {len(found)}, gap shrunk by {median} in the median; without "
        f"a law: other effects named in {named}, no gap on held-out runs in {blind}\n"
    )


def _told(case: Case, asked: argparse.Namespace) -> Outcome:
    """What is said of a case; printed as well."""
    strip = find_configs(None).folder / "strips" / f"{case.strip}.yaml"
    with TemporaryDirectory() as name:
        out = Path(name)
        without = sorted(_withheld(case))
        runs = [asked.exam / "runs" / case.name]
        if asked.repeats > 1:
            runs = [out / "runs"]
            make_runs(case.model_copy(update={"repeats": asked.repeats}), runs[0])
        verdict = fit(runs, strip, out, jobs=asked.jobs, without=without)
        law = json.loads((out / RECORD).read_text(encoding="utf-8"))["law"]
    named: Sequence[str] = [e.name for e in verdict.effects]
    said = "no law" if law is None else f"{100 * law['shrink']:.0f} % by {law['words']}"
    gap = verdict.gap.before["excess"]
    sys.stdout.write(
        f"{case.name}: without {', '.join(without) or 'nothing'} ({case.strength or '-'}, scatter "
        f"{case.scatter}), gap {gap:.2f}: {verdict.verdict} {', '.join(named)}: {said}\n"
    )
    sys.stdout.flush()
    effect, shrink = next(iter(case.effects), "nothing"), law and float(law["shrink"])
    return Outcome(effect, shrink, bool(named), gap, verdict.gap.shrink)


def _withheld(case: Case) -> frozenset[str]:
    """What a case hides, and what no run tells from it: a twin in the library would answer."""
    return frozenset(case.effects).union(*(registry()[name].looks_like for name in case.effects))


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("exam", type=Path)
    parser.add_argument("--cases", type=int, default=4)
    parser.add_argument("--skip", type=int, default=0)
    parser.add_argument("--nothing", type=int, default=1)
    parser.add_argument("--repeats", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
