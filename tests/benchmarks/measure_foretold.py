"""Folds through images by `adaptive`, and how well each was foretold.

python -m tests.benchmarks.measure_foretold [--strips denim,blanket] [--plants denim] [--seeds N]
    [--jobs J] [--runs DIR]

Folds strips as their files say, and with --plants those of configs/plants, whose effects nobody
knows.

Prints the displacement and the final offset of the edges by truth [mm], what was foretold at the
touch, and the rod's residual (`policies.agreement`); in the end |d| and |offset|, how far the
repeats of a strip lie from their middle at worst, the share of folds within one and 1.96 sigma, and
mean and sigma of d minus what was foretold: what is left of the critic's bias, which
`policies.adaptive.bias` holds as THROUGH_IMAGES.
"""

import argparse
from pathlib import Path

import numpy as np

from cell.config.places import find_configs
from cell.devices.devices import DeviceSelection
from cell.operations.batch import side_by_side
from cell.operations.fold import Request
from cell.operations.result import FoldResult
from cell.record.run import read_run
from drivers.types import Array


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--strips", default=",".join(find_configs(None).strip_names()))
    parser.add_argument("--plants", default="")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--runs", type=Path, default=Path("runs/foretold"))
    return parser.parse_args()


def tell(result: FoldResult) -> Array:
    """d, offset, foretold d and sigma [mm], and whether the strip was flagged; NaN where none."""
    stored = read_run(Path(result.run)).result
    told = None if stored is None else stored.foretold
    agreed = None if stored is None else stored.agreement
    lengths: tuple[float | None, ...] = (result.displacement_true, result.edge_offset_true)
    lengths += (None, None) if told is None else (told.displacement, told.sigma)
    row = [1e3 * np.nan if value is None else 1e3 * value for value in lengths]
    residual = np.nan if agreed is None else 1e3 * agreed.residual
    flagged = agreed is not None and not agreed.like_model
    print(
        f"{result.strip:14s} seed {result.seed} {result.outcome:12s} d {row[0]:+5.1f}, foretold "
        f"{row[2]:+5.1f} +- {row[3]:.1f}, edges {row[1]:+5.1f} mm, residual {residual:.2f} mm"
        f"{', FLAGGED' if flagged else ''}",
        flush=True,
    )
    return np.array([*row, flagged])


def names(given: str) -> list[str]:
    return [name for name in given.split(",") if name]


def wanted(asked: argparse.Namespace) -> list[Request]:
    """Folds of all strips and plants, the seeds of one side by side."""
    plants = find_configs(None).folder / "plants"
    subjects: list[tuple[str, Path | None]] = [(strip, None) for strip in names(asked.strips)]
    subjects += [(plant, plants / f"{plant}.yaml") for plant in names(asked.plants)]
    return [
        Request(
            *(strip, "adaptive", None, DeviceSelection(plant=plant, seed=seed), asked.runs),
            *(None, None, True, "off"),
        )
        for strip, plant in subjects
        for seed in range(asked.seeds)
    ]


def main() -> None:
    asked = arguments()
    rows = np.array([tell(result) for result in side_by_side(wanted(asked), asked.jobs)])
    for name, column in (("|d|", 0), ("|edges|", 1)):
        size = np.abs(rows[:, column])
        numbers = np.nanmean(size), np.nanquantile(size, 0.95), np.nanmax(size)
        print(f"{name:8s} mean {numbers[0]:.2f}, 95 % {numbers[1]:.2f}, worst {numbers[2]:.2f} mm")
    repeats = rows[:, 0].reshape(-1, asked.seeds)
    print(f"repeats within {np.ptp(repeats, axis=1).max() / 2:.2f} mm of their middle, at worst")
    off = rows[:, 0] - rows[:, 2]
    ratio = np.abs(off) / rows[:, 3]
    print(
        f"within one sigma {100 * np.mean(ratio < 1):.0f} %, within 1.96 "
        f"{100 * np.mean(ratio < 1.96):.0f} %; d minus foretold "
        f"{np.nanmean(off):+.2f} mm, sigma {np.nanstd(off):.2f} mm; flagged "
        f"{rows[:, 4].sum():.0f} of {len(rows)}"
    )


if __name__ == "__main__":
    main()
