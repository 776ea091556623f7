"""How well the camera sees where the laid edges lie, against the twin's truth.

python -m tests.benchmarks.measure_edges RUNS...

RUNS are folders of folds of the twin; a line a strip, and all of them together. cell.yaml states
the root mean square as `sigma: edge_offset`.
"""

import argparse
import sys
from collections import defaultdict
from pathlib import Path

import numpy as np

from cell.record.run import read_run
from cell.record.truth import read_truth


def errors(folders: list[Path]) -> dict[str, list[float]]:
    """Edge offset as seen minus true [m] of every completed fold that has both, by strip."""
    found: dict[str, list[float]] = defaultdict(list)
    for head in sorted(path for folder in folders for path in folder.glob("*/run.yaml")):
        run, truth = read_run(head.parent), read_truth(head.parent)
        true = None if truth is None else truth.get("edge_offset")
        result = run.result
        if result is None or result.edge_offset is None or true is None:
            continue
        if result.outcome == "layer_touch":
            found[run.header.strip].append(result.edge_offset - float(true))
    return dict(found)


def line(name: str, off: list[float]) -> str:
    """Mean, root mean square and largest error [mm]."""
    mm = 1e3 * np.array(off)
    rms = np.sqrt(np.mean(mm**2))
    worst = np.abs(mm).max()
    return f"{name:16s} {len(mm):4d} folds  mean {mm.mean():+.2f}  rms {rms:.2f}  worst {worst:.2f}"


def main() -> None:
    """Print them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("runs", type=Path, nargs="+")
    found = errors(parser.parse_args().runs)
    for strip, off in found.items():
        sys.stdout.write(line(strip, off) + "\n")
    sys.stdout.write(line("all", [e for off in found.values() for e in off]) + "\n")


if __name__ == "__main__":
    main()
