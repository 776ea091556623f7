"""Estimates how much runs differ from one another, where the truth is known.

python -m tests.benchmarks.measure_spreads [--cases 6] [--seed 0] [--level full]

Every case has nothing hidden and differs from run to run at the exam's `level`. What is printed are
the estimated spreads over the true ones, and over what the drawn runs happen to have.
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from cell.config.places import find_configs
from cell.exam.case import Case
from cell.exam.cases.draw import SLOWER, STIFFER
from cell.exam.runs.from_model import MOTIONS, make_runs
from cell.exam.runs.scatter import LEVELS, RunScatter
from cell.gap.fit import open_subject
from cell.gap.fitting.model import Model, evidence
from cell.gap.fitting.spreads import spreads
from cell.gap.fitting.starts import refit_base
from cell.gap.subject.run_folders import find_runs

QUANTITIES = ("grip_x", "grip_z", "damping", "stiffness")


def main() -> int:
    """Draw, make, fit the base, and tell."""
    asked = _arguments()
    rng = np.random.default_rng(asked.seed)
    nominal, drawn = [], []
    for number in range(asked.cases):
        case = _case(asked.level, number, rng)
        found, true = _estimated(case), _drawn(case)
        stated = _stated(case)
        nominal.append([found.get(name, 0.0) / stated[name] for name in QUANTITIES])
        drawn.append([found.get(name, 0.0) / true[name] for name in QUANTITIES])
        others = ", ".join(sorted(set(found) - set(QUANTITIES))) or "-"
        _say(f"{case.strip:14s} {_row(nominal[-1])}   of those drawn {_row(drawn[-1])}   {others}")
    _say(f"{'median':14s} {_row(np.median(nominal, axis=0))}   of those drawn "
         f"{_row(np.median(drawn, axis=0))}   ({', '.join(QUANTITIES)})")  # fmt: skip
    return 0


def _case(level: str, number: int, rng: np.random.Generator) -> Case:
    return Case(
        name=f"spread-{number:03d}",
        tier="state",
        kind="nothing",
        strip=str(rng.choice(find_configs(None).strip_names())),
        seed=int(rng.integers(2**31)),
        stiffness=float(STIFFER ** rng.uniform(-1, 1)),
        damping=float(SLOWER ** rng.uniform(-1, 1)),
        scatter=level,
    )


def _estimated(case: Case) -> dict[str, float]:
    """Spreads by name that the runs of a case show beside the refitted base."""
    with TemporaryDirectory() as name:
        make_runs(case, Path(name))
        file = find_configs(None).strip_path(case.strip)
        subject = open_subject(file, find_runs([Path(name)]), jobs=1)
        known = evidence(subject.runs)
        rng = np.random.default_rng(0)
        base = refit_base(subject.simulate, Model(subject.scope.base), known, rng)
        return {spread.name: spread.value for spread in spreads(base)}


def _stated(case: Case) -> dict[str, float]:
    """The standard deviations from which a case is drawn."""
    level = LEVELS[case.scatter]
    values = (level.grip, level.grip, level.damping, level.stiffness)
    return dict(zip(QUANTITIES, values, strict=True))


def _drawn(case: Case) -> Mapping[str, float]:
    """Standard deviations of what the runs of a case have."""
    runs = [RunScatter.draw(case.scatter, case.seed, i) for i in range(len(MOTIONS))]
    each = np.array([[*run.grip, run.damping, run.stiffness] for run in runs])
    return dict(zip(QUANTITIES, each.std(axis=0, ddof=1), strict=True))


def _row(shares: Sequence[float]) -> str:
    return " ".join(f"{share:5.2f}" for share in shares)


def _say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--cases", type=int, default=6)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--level", choices=("half", "full"), default="full")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
