"""Folds strips through images and prints how they went, and how images, truth and model agree.

python -m tests.benchmarks.measure_folds [--strips denim,blanket] [--policies triangular,feedback]
    [--jobs 2] [--runs DIR]
"""

import argparse
from pathlib import Path

import numpy as np

from cell.config.places import find_configs
from cell.devices.devices import DeviceSelection
from cell.operations.batch import side_by_side
from cell.operations.fold import Request
from cell.operations.result import FoldResult
from tests.support.resimulate import resimulate

POLICIES = "triangular,circular,shifted,feedback"


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--strips", default=",".join(find_configs(None).strip_names()))
    parser.add_argument("--policies", default=POLICIES)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--runs", type=Path, default=Path("runs"))
    return parser.parse_args()


def wanted(strips: list[str], policies: list[str], runs: Path) -> list[Request]:
    return [
        Request(strip, policy, None, DeviceSelection(seed=seed), runs, None, None, True, "off")
        for policy in policies
        for seed, strip in enumerate(strips)
    ]


def tell(result: FoldResult) -> tuple[float, float, float]:
    """Seen, seen minus true, and model minus seen displacement [mm], NaN without a touch."""
    seen = 1e3 * result.displacement if result.displacement is not None else np.nan
    true = 1e3 * result.displacement_true if result.displacement_true is not None else np.nan
    rod = resimulate(Path(result.run)).simulated
    model = 1e3 * rod if rod is not None else np.nan
    print(
        f"{result.policy:11s} {result.strip:14s} {result.outcome:12s} seen {seen:+7.1f} mm  "
        f"seen-true {seen - true:+5.1f}  rod-true {model - true:+5.1f}  "
        f"wall/duration {result.wall / result.duration:4.2f}",
        flush=True,
    )
    return seen, seen - true, model - true


def main() -> None:
    asked = arguments()
    policies = asked.policies.split(",")
    requests = wanted(asked.strips.split(","), policies, asked.runs)
    rows: dict[str, list[tuple[float, float, float]]] = {policy: [] for policy in policies}
    for result in side_by_side(requests, asked.jobs):
        rows[result.policy].append(tell(result))
    for policy, found in rows.items():
        seen, image, model = np.array(found).T
        print(
            f"{policy:11s} mean {np.mean(seen):+6.1f} mm, {np.min(seen):+6.1f} to "
            f"{np.max(seen):+6.1f}, worst |d| {np.max(np.abs(seen)):5.1f}; "
            f"worst |seen-true| {np.max(np.abs(image)):4.1f}, "
            f"worst |rod-true| {np.max(np.abs(model)):4.1f}"
        )


if __name__ == "__main__":
    main()
