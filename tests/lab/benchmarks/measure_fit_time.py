"""Time and memory of `cell gap fit` on the runs of an exam.

python -m tests.lab measure-fit-time FOLDER [--cases 12] [--jobs 2]

FOLDER is that of `python -m tests.lab exam --out FOLDER --only-make`. So many cases, spread evenly
over all kinds, are fitted each in a process of its own, one after another, on `--jobs` cores; the
first fit is made twice and its first time left out, for it may compile. Nothing else should run
meanwhile.
"""

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np

from cell.config.places import find_configs
from cell.record.files import RUN
from drivers.readers import read_yaml
from tests.lab.exam.run import MADE, RUNS_FOLDER


class Cost(NamedTuple):
    """Cost of one fit: the number of `runs`, time [s] and peak memory [MB] of its process."""

    case: str
    runs: int
    time: float
    memory: float


def fit(exam: Path, case: str, jobs: int) -> Cost:
    """Fit the runs of one case; raises SystemExit where the fit fails."""
    runs = exam / RUNS_FOLDER / case
    header = read_yaml(next(runs.glob(f"*/{RUN}")))
    strip = find_configs(None).strip_path(header["strip"])
    with TemporaryDirectory() as out:
        command = [sys.executable, "-m", "cell", "gap", "fit", str(runs), "--strip", str(strip)]
        began = time.monotonic()
        process = subprocess.Popen(
            [*command, "--out", out, "--jobs", str(jobs)], stdout=subprocess.DEVNULL
        )
        _, status, used = os.wait4(process.pid, 0)
        taken = time.monotonic() - began
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"{case}: `cell gap fit` ended with {process.returncode}")
    folders = sum(1 for path in runs.iterdir() if path.is_dir())
    return Cost(case, folders, taken, used.ru_maxrss / 1024.0)


def measure(exam: Path, most: int, jobs: int) -> Iterator[Cost]:
    """Yield the cost of `most` cases, evenly spaced among those whose runs are made."""
    made = sorted(path.parent.name for path in (exam / RUNS_FOLDER).glob(f"*/{MADE}"))
    if not made:
        raise SystemExit(f"{exam}: holds no runs; make them with `exam --only-make`")
    chosen = np.linspace(0, len(made) - 1, min(most, len(made))).round().astype(int)
    for i in [chosen[0], *chosen]:
        yield fit(exam, made[i], jobs)


def main(exam: Path, cases: int = 12, jobs: int = 2) -> None:
    """Print the cost of each fit, the median and the worst."""
    found = []
    for cost in measure(exam, cases, jobs):
        found.append(cost)
        sys.stdout.write(
            f"{cost.case}: {cost.runs} runs, {cost.time:.1f} s, {cost.memory:.0f} MB\n"
        )
        sys.stdout.flush()
    times = [cost.time for cost in found[1:]]
    sys.stdout.write(
        f"{len(times)} fits on {jobs} cores: {np.median(times):.1f} s in the median, "
        f"{max(times):.1f} s at worst, {max(cost.memory for cost in found):.0f} MB\n"
    )
