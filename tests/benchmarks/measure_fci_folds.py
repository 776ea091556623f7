"""Folds through the robot's own library beside folds by the in-process arm.

`python -m tests.benchmarks.measure_fci_folds [STRIP ...] [--twice]`: a line a strip with both true
displacements, their difference, and how long the fold took of the wall clock over its own duration;
with --twice each fold through the library is made twice and its files are compared byte by byte.
"""

import sys
import tempfile
from dataclasses import replace
from pathlib import Path

from cell.config.places import find_configs
from cell.devices.devices import DeviceSelection
from cell.operations.fold import Request, fold
from cell.operations.result import FoldResult

FILES = ("ticks.parquet", "profile.parquet", "result.yaml")
ALLOWED = 1.5e-3  # m between the two arms


def main(words: list[str]) -> int:
    twice = "--twice" in words
    strips = [w for w in words if not w.startswith("--")] or find_configs(None).strip_names()
    print("| strip | fci [mm] | in process [mm] | difference [mm] | wall / duration | same bytes |")
    print("|---|---|---|---|---|---|", flush=True)
    with tempfile.TemporaryDirectory() as runs:
        good = [_told(strip, Path(runs), twice=twice) for strip in strips]
    return 0 if all(good) else 1


def _told(strip: str, runs: Path, *, twice: bool) -> bool:
    request = _request(strip, runs)
    fci = fold(request, page=False)
    again = fold(request, page=False) if twice else None
    beside = fold(replace(request, choice=DeviceSelection(arm="twin", seed=3)), page=False)
    same = again is None or _bytes(fci) == _bytes(again)
    if fci.displacement_true is None or beside.displacement_true is None:
        print(f"| {strip} | {fci.outcome} | {beside.outcome} | | | |", flush=True)
        return False
    a, b = fci.displacement_true, beside.displacement_true
    pace = fci.wall / fci.duration
    words = "" if again is None else ("yes" if same else "NO")
    print(
        f"| {strip} | {1e3 * a:+.2f} | {1e3 * b:+.2f} | {1e3 * (a - b):+.2f} | {pace:.1f} | "
        f"{words} |",
        flush=True,
    )
    return same and abs(a - b) <= ALLOWED


def _request(strip: str, runs: Path) -> Request:
    return Request(
        strip=strip,
        policy="triangular",
        checkpoint=None,
        runs=runs,
        configs=None,
        choice=DeviceSelection(arm="fci", seed=3),
        frames="none",
        truth=True,
        viz="off",
    )


def _bytes(result: FoldResult) -> list[bytes]:
    return [(Path(result.run) / name).read_bytes() for name in FILES]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
