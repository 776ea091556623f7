"""Fold after fold in one process: does it keep memory or handles, or change what it does?

    python -m tests.lab soak [--count 500] [--strip denim] [--policy triangular]

Prints memory and open handles after each fold. Exit code 1 where the memory has grown by more than
50 MB since the tenth fold, a handle, child or thread is left, or the last fold, made with the seed
of the first, does not hold the same bytes.
"""

import gc
import hashlib
import os
import tempfile
import threading
import time
from multiprocessing import active_children
from pathlib import Path

from cell.devices.devices import DeviceSelection
from cell.folding.fold import fold
from cell.record.files import PROFILE, RESULT, TICKS
from tests.support.requests import request_for

SETTLED, GROWTH = 10, 50.0  # folds after which memory is counted, MB by which it may grow


def resident() -> float:
    """Memory of this process [MB], once garbage is gone."""
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def handles() -> int:
    """Open files and sockets, threads and child processes."""
    return (
        len(list(Path("/proc/self/fd").iterdir()))
        + threading.active_count()
        + len(active_children())
    )


def content(run: Path) -> str:
    """Digest of what a fold measured."""
    h = hashlib.sha256()
    for name in (TICKS, PROFILE, RESULT):
        h.update((run / name).read_bytes())
    return h.hexdigest()[:16]


def main(count: int = 500, strip: str = "denim", policy: str = "triangular") -> int:
    """Fold so often; the exit code."""
    seen: list[tuple[float, int]] = []
    digests = []
    print("| fold | MB | handles | s |\n|---|---|---|---|")
    for number in range(count):
        begun = time.perf_counter()
        with tempfile.TemporaryDirectory() as runs:
            last = number == count - 1
            choice = DeviceSelection(seed=0 if last else number)
            result = fold(request_for(strip, policy, Path(runs), choice=choice))
            if number == 0 or last:
                digests.append(content(Path(result.run)))
        seen.append((resident(), handles()))
        took = time.perf_counter() - begun
        print(f"| {number + 1} | {seen[-1][0]:.0f} | {seen[-1][1]} | {took:.1f} |", flush=True)
    first = seen[min(SETTLED, len(seen)) - 1]
    grown, left = seen[-1][0] - first[0], seen[-1][1] - first[1]
    same = digests[0] == digests[-1]
    words = "the same bytes" if same else "OTHER bytes"
    print(f"since the tenth: {grown:+.0f} MB, {left:+d} handles; first and last fold hold {words}")
    return int(grown > GROWTH or left > 0 or not same)
