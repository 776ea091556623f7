"""What fits of the gap workflow cost: processor and wall time, simulations, memory.

python -m tests.benchmarks.bench_gap EXAM [--cases N] [--skip 0] [--only NAME,...] [--jobs 2]
    [--runs N] [--profile FILE]

EXAM is the folder of an exam from the state; of each case the first N runs are fitted, or all.
Each case is fitted in a process of its own, its kernels compiled before; a `lane-step` is one step
of one simulated strip. With `--profile` a single case is fitted under cProfile by processor time,
and the profile is written to FILE.
"""

import argparse
import cProfile
import multiprocessing
import resource
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np

import cell.gap.subject.strip.simulation as strip_simulation
from cell.config.places import find_configs
from cell.exam.case import Case
from cell.exam.cases.answer_key import KEYS, opened
from cell.gap.fit import fit
from cell.gap.verdict.schema import Verdict
from drivers.strip.engine import StripMotion


class Cost(NamedTuple):
    """Of one fit: `processor` and `wall` [s], motions simulated, their steps, `memory` [MB]."""

    processor: float
    wall: float
    motions: int
    steps: int
    memory: float
    said: str


class Tally:
    """Counts what the rod simulates; stands in for the simulation of a batch."""

    def __init__(self) -> None:
        self._simulate = strip_simulation.simulate_all
        self.motions = self.steps = 0

    def __call__(self, *args: object, **options: object) -> list[StripMotion]:
        """The motions of a batch, counted."""
        motions: list[StripMotion] = self._simulate(*args, **options)  # type: ignore[arg-type]
        self.motions += len(motions)
        self.steps += sum(len(motion.t) for motion in motions)
        return motions


def main() -> int:
    """Fit case by case, each told in a line, then the median and the worst."""
    asked = _arguments()
    cases = _cases(asked)
    if asked.profile is not None:
        _profiled(cases[0], asked)
        return 0
    processes = multiprocessing.get_context("spawn")
    costs = []
    for case in cases:
        with processes.Pool(1) as pool:
            cost = pool.apply(_measured, (asked.exam, case, asked.jobs, asked.runs))
        sys.stdout.write(_line(case, cost))
        sys.stdout.flush()
        costs.append(cost)
    _summed(costs)
    return 0


def _cases(asked: argparse.Namespace) -> list[Case]:
    """The cases with runs, in order, or those that are named."""
    whole = [opened(asked.exam, path.stem) for path in sorted((asked.exam / KEYS).glob("*.yaml"))]
    made = [case for case in whole if (asked.exam / "runs" / case.name).is_dir()]
    if asked.only:
        names = asked.only.split(",")
        return [case for case in made if any(case.name.endswith(name) for name in names)]
    return made[asked.skip :][: asked.cases]


def _measured(exam: Path, case: Case, jobs: int, runs: int | None) -> Cost:
    """Cost of the fit of a case, in this process."""
    tally = Tally()
    strip_simulation.simulate_all = tally
    wall, processor = time.perf_counter(), time.process_time()
    verdict = _fitted(exam, case, jobs, runs)
    wall, processor = time.perf_counter() - wall, time.process_time() - processor
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return Cost(processor, wall, tally.motions, tally.steps, memory, _said(verdict))


def _fitted(exam: Path, case: Case, jobs: int, runs: int | None) -> Verdict:
    """The verdict on the first `runs` of a case, or all."""
    folders = sorted(path for path in (exam / "runs" / case.name).iterdir() if path.is_dir())
    strip = find_configs(None).folder / "strips" / f"{case.strip}.yaml"
    with TemporaryDirectory() as name:
        return fit(folders[:runs], strip, Path(name), jobs=jobs)


def _said(verdict: Verdict) -> str:
    """The verdict in a line: names with sizes, base, best candidates with nats, what is left."""
    named = [
        f"{e.name} ({', '.join(f'{k} {m.value:.4g}' for k, m in e.parameters.items())})"
        f" {e.confidence:.2f}"
        for e in verdict.effects
    ]
    either = [f"one of {', '.join(group)}" for group in verdict.ambiguous]
    base = ", ".join(f"{k} {v.value:.4g}" for k, v in verdict.base.items())
    best = ", ".join(f"{c.name} {c.elpd_gain:.1f}" for c in verdict.candidates[:3])
    gap = f"{verdict.gap.before['excess']:.2f} to {verdict.gap.after['excess']:.2f}"
    return f"{verdict.verdict} {'; '.join(named + either)} | {base} | {best} nats | gap {gap}"


def _line(case: Case, cost: Cost) -> str:
    hidden = ", ".join(case.effects) or case.kind
    return (
        f"{case.name} {case.strip} ({hidden}, {case.strength or '-'}, scatter {case.scatter}): "
        f"processor {cost.processor:.1f} s, wall {cost.wall:.1f} s, {cost.motions} motions, "
        f"{cost.steps / 1e6:.2f} M lane-steps, {cost.memory:.0f} MB: {cost.said}\n"
    )


def _summed(costs: Sequence[Cost]) -> None:
    columns = {
        "processor s": [c.processor for c in costs],
        "wall s": [c.wall for c in costs],
        "motions": [c.motions for c in costs],
        "M lane-steps": [c.steps / 1e6 for c in costs],
        "MB": [c.memory for c in costs],
    }
    for name, values in columns.items():
        sys.stdout.write(f"{name}: median {np.median(values):.1f}, worst {max(values):.1f}\n")


def _profiled(case: Case, asked: argparse.Namespace) -> None:
    """The functions of one fit by the processor time that they took themselves."""
    profile = cProfile.Profile(time.process_time)
    verdict = profile.runcall(_fitted, asked.exam, case, asked.jobs, asked.runs)
    profile.dump_stats(asked.profile)
    sys.stdout.write(f"{case.name}: {_said(verdict)}; profile in {asked.profile}\n")


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("exam", type=Path)
    parser.add_argument("--cases", type=int, default=12)
    parser.add_argument("--skip", type=int, default=0)
    parser.add_argument("--only", default="", help="ends of the names of cases")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--runs", type=int, default=None, help="of each case, the first so many")
    parser.add_argument("--profile", type=Path, default=None)
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
