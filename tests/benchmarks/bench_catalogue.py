"""Processor time of a list of many runs: `python -m tests.benchmarks.bench_catalogue [COUNT]`.

Aim: 10,000 known runs listed, filtered and sorted in at most 0.3 s.
"""

import sys
import tempfile
import time
from pathlib import Path

from tests.cell.record.test_catalogue import lay, names


def main(count: int) -> None:
    """Print the time of the first list, which reads every folder, and of five more [s]."""
    with tempfile.TemporaryDirectory() as scratch:
        root, cache = Path(scratch) / "runs", Path(scratch) / "cache"
        for number in range(count):
            lay(root, number)
        costs = []
        for _ in range(6):
            begun = time.process_time()
            found = names(root, cache, "displacement > 0.5", "-edge_offset")
            costs.append(time.process_time() - begun)
    again = sorted(costs[1:])
    print(
        f"{count} runs, {len(found)} found: first {costs[0]:.2f} s, then {again[2]:.3f} s (median)"
    )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 10_000)
