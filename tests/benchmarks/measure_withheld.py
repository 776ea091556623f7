"""Withholds from the library what an exam's cases hide, and tells whether a law is offered.

python -m tests.benchmarks.measure_withheld EXAM [--cases 4] [--nothing 1] [--jobs 1]

EXAM is the folder of an exam from the state. Of the cases that hide a single effect of medium
strength or more, so many are fitted without it; so many that hide nothing are fitted as they are.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from cell.config.places import find_configs
from cell.exam.case import Case
from cell.exam.cases.answer_key import KEYS, opened
from cell.gap.fit import fit
from cell.gap.verdict.accept import RECORD


def main() -> int:
    """Fit, and tell case by case; 1 where a law is offered though nothing is hidden."""
    asked = _arguments()
    whole = [opened(asked.exam, path.stem) for path in sorted((asked.exam / KEYS).glob("*.yaml"))]
    made = [case for case in whole if (asked.exam / "runs" / case.name).is_dir()]
    hidden = [c for c in made if c.kind == "single" and c.alike and c.strength != "weak"]
    empty = [c for c in made if c.kind == "nothing"]
    offered = [_told(case, asked) for case in islice(hidden, asked.cases)]
    false = [_told(case, asked) for case in islice(empty, asked.nothing)]
    shrinks = [s for s in offered if s is not None]
    median = f"{100 * np.median(shrinks):.0f} %" if shrinks else "-"
    sys.stdout.write(
        f"offered in {len(shrinks)} of {len(offered)}, gap shrunk by {median} in the median; "
        f"offered where nothing is hidden in {sum(s is not None for s in false)} of {len(false)}\n"
    )
    return int(any(s is not None for s in false))


def _told(case: Case, asked: argparse.Namespace) -> float | None:
    """The share of the held-out gap that an offered law closes, None without one; said as well."""
    strip = find_configs(None).folder / "strips" / f"{case.strip}.yaml"
    with TemporaryDirectory() as name:
        out = Path(name)
        without = sorted(case.effects)
        runs = [asked.exam / "runs" / case.name]
        verdict = fit(runs, strip, out, jobs=asked.jobs, without=without)
        law = json.loads((out / RECORD).read_text(encoding="utf-8"))["law"]
    named: Sequence[str] = [e.name for e in verdict.effects]
    said = "no law" if law is None else f"{100 * law['shrink']:.0f} % by {law['words']}"
    sys.stdout.write(
        f"{case.name}: without {', '.join(without) or 'nothing'} ({case.strength or '-'}, scatter "
        f"{case.scatter}), gap {verdict.gap.before['excess']:.2f}: {verdict.verdict} "
        f"{', '.join(named)}: {said}\n"
    )
    sys.stdout.flush()
    return None if law is None else float(law["shrink"])


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("exam", type=Path)
    parser.add_argument("--cases", type=int, default=4)
    parser.add_argument("--nothing", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
