"""What gap a cause of the exam leaves on a strip: `python -m tests.benchmarks.measure_causes NAME`.

python -m tests.benchmarks.measure_causes NAME [--strip denim] [--amounts 0.01,0.02]
    [--setting position=0.5]

A chain of 100 links with the cause goes through the motions of a case from the state, measured as a
cell does; the gap is what the workflow's refitted base leaves on held-out runs. Without --amounts
those of the exam are taken, which should leave about 2.5 and 6. What the workflow says is no
criterion: sizes are set by the gap alone.
"""

import argparse
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from cell.config.places import find_configs
from cell.exam.causes import cause_of, causes
from cell.exam.runs.from_model import MOTIONS
from cell.exam.runs.specimen import Specimen
from cell.gap.fit import fit
from cell.gap.subject.strip.synthetic import Fold, Instruments, write_fold
from cell.gap.subject.strip.ways import way_of
from cell.gap.verdict.schema import Verdict
from drivers.strip.describe import describe
from drivers.strip.engine import simulate
from policies.experiments.standard import STANDARD
from policies.registry import MOTION

LINKS, STEP = 100, 0.004
BY = Instruments(contact_x=0.0015, profile=0.001, rate=60.0)


def main() -> int:
    """One line an amount."""
    asked = _arguments()
    kind = causes()[asked.name]
    amounts = asked.amounts or [values[kind.amount] for values in kind.sizes.values()]
    for amount in amounts:
        found = _verdict(asked.name, {kind.amount: amount, **asked.setting}, asked.strip)
        gap = found.gap.before
        sys.stdout.write(
            f"{asked.name} {kind.amount} {amount:g} on {asked.strip}: excess gap "
            f"{gap['excess']:.2f} (profile {gap['profile_mm']:.2f} mm, contact "
            f"{gap['contact_x_mm']:.2f} mm)\n"
        )
        sys.stdout.flush()
    return 0


def _verdict(name: str, values: dict[str, float], strip: str) -> Verdict:
    file = find_configs(None).strip_path(strip)
    known = find_configs(None).strip(strip)
    rng = np.random.default_rng(1)
    with TemporaryDirectory() as place:
        runs = Path(place) / "runs"
        for index, motion in enumerate(MOTIONS):
            way = way_of(STANDARD[motion].of(known.length))
            plant = Specimen(LINKS, [cause_of(name, values)], 7)
            model = describe(known, {}, index)
            moved = simulate(plant, model, way.t, way.poses, dt=STEP, shapes=True)
            arc = np.linspace(0.0, known.length, moved.shapes.shape[1])
            fold = Fold(way, model, moved, moved.t, arc, index, MOTION + motion)
            write_fold(runs / f"{index:02d}-{motion}", strip, fold, BY, rng)
        return fit([runs], file, Path(place) / "out")


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="The gap that a cause leaves.")
    parser.add_argument("name", choices=sorted(causes()))
    parser.add_argument("--strip", default="denim")
    parser.add_argument("--amounts", type=lambda s: [float(v) for v in s.split(",")], default=None)
    parser.add_argument(
        "--setting", type=lambda s: (s.split("=")[0], float(s.split("=")[1])), action="append",
        default=[],
    )  # fmt: skip
    asked = parser.parse_args()
    asked.setting = dict(asked.setting)
    return asked


if __name__ == "__main__":
    sys.exit(main())
