"""Folds every strip with the wizards' calibration and with the twin's own, side by side.

python -m tests.benchmarks.measure_calibrated_folds [--strips denim,blanket] [--policy feedback]

The wizards run as an operator starts them: `cell calibrate camera`, then `cell calibrate
homography`, unattended. Prints the true displacement of both folds [mm]; fails where the mean of
|d| changes by more than 0.5 mm or that of a strip by more than 1.5 mm.
"""

import argparse
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from calibration.calibration import Calibration, load_calibration
from cell.config.places import find_configs
from cell.devices.devices import DeviceSelection
from cell.operations.calibrate import calibration_of
from cell.operations.fold import Request, fold

MEAN_BAR, EACH_BAR = 0.5, 1.5  # mm


def by_wizard(folder: Path) -> Calibration:
    """The calibration that both wizards leave, run in `folder`."""
    for kind in ("camera", "homography"):
        command = [sys.executable, "-m", "cell", "calibrate", kind, "--viz", "off"]
        subprocess.run(command, cwd=folder, check=True, stdout=subprocess.DEVNULL)
    return load_calibration(next(folder.glob("calibrations/*-homography/calibration.yaml")))


def true_displacement(strip: str, policy: str, runs: Path, calibration: Calibration) -> float:
    """d by truth [mm] of one fold, NaN where it did not end in a touch."""
    request = Request(strip, policy, None, DeviceSelection(), runs, None, None, True, "off")
    found = fold(request, calibration=calibration, page=False).displacement_true
    return float("nan") if found is None else 1e3 * found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--strips", default=",".join(find_configs(None).strip_names()))
    parser.add_argument("--policy", default="feedback")
    asked = parser.parse_args()
    with TemporaryDirectory() as place:
        folder = Path(place)
        own, wizard = calibration_of(find_configs(None).cell()), by_wizard(folder)
        rows = []
        for strip in asked.strips.split(","):
            both = [true_displacement(strip, asked.policy, folder, each) for each in (own, wizard)]
            rows.append(both)
            print(f"{strip:14s} own {both[0]:+5.2f}  wizard's {both[1]:+5.2f} mm", flush=True)
    size = np.abs(np.array(rows))
    mean, most = abs(float(np.diff(size.mean(axis=0))[0])), float(np.abs(np.diff(rows)).max())
    print(f"mean |d| differs by {mean:.2f} mm (bar {MEAN_BAR}), d by at most {most:.2f} mm")
    return 0 if mean <= MEAN_BAR and most <= EACH_BAR else 1


if __name__ == "__main__":
    sys.exit(main())
