"""Folds many times in one process, to find leaks of memory or file handles.

    python -m tests.lab soak [--count 500] [--strip denim] [--policy triangular]

Each fold makes its film, page and recording. Prints memory and open handles after each. Exit code
1 where the memory has grown by more than 50 MB since the tenth fold, or a handle, child or thread,
those of libraries too, is left.
"""

import gc
import os
import tempfile
import time
from multiprocessing import active_children
from pathlib import Path

from cell.devices.devices import Trial
from cell.folding.batch import fold_all
from cell.folding.request import Recording
from tests.support.requests import request_for

EVERYTHING = Recording("all", "libx264", viz="save")
SETTLED, GROWTH = 10, 50.0  # folds after which memory is counted, MB by which it may grow


def resident() -> float:
    """Resident memory of this process [MB] after a garbage collection."""
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def handles() -> int:
    """Number of open files and sockets, threads and child processes."""
    entries = (Path("/proc/self", name).iterdir() for name in ("fd", "task"))
    return sum(len(list(each)) for each in entries) + len(active_children())


def main(count: int = 500, strip: str = "denim", policy: str = "triangular") -> int:
    """Fold `count` times and print memory and handles; returns the exit code."""
    seen: list[tuple[float, int]] = []
    print("| fold | MB | handles | s |\n|---|---|---|---|")
    for number in range(count):
        begun = time.perf_counter()
        with tempfile.TemporaryDirectory() as runs:
            trial = Trial(seed=number)
            made = request_for(strip, policy, Path(runs), trial=trial, record=EVERYTHING)
            list(fold_all([made]))
        seen.append((resident(), handles()))
        took = time.perf_counter() - begun
        print(f"| {number + 1} | {seen[-1][0]:.0f} | {seen[-1][1]} | {took:.1f} |", flush=True)
    first = seen[min(SETTLED, len(seen)) - 1]
    grown, left = seen[-1][0] - first[0], seen[-1][1] - first[1]
    print(f"since the tenth: {grown:+.0f} MB, {left:+d} handles")
    return int(grown > GROWTH or left > 0)
