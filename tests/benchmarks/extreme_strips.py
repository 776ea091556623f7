"""Ten extreme strips that a strip file may state, by every policy, through images.

`python -m tests.benchmarks.extreme_strips [--strips NAME,...] [--policies NAME,...]` prints how
each fold ended. Good ends: the layers truly touched within 25 mm, or the fold was refused before
anything moved, or it was stopped and says why. A fold that claims a touch the twin does not know,
or another displacement than the twin's by more than 10 mm, is marked `UNTRUE`, exit code 1; one
that truly is further off than 25 mm, and says so, is marked `far`.
"""

import argparse
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import yaml

from cell.config.places import find_configs
from cell.devices.devices import DeviceSelection
from cell.operations.calibrate import calibration_of
from cell.operations.fold import Request, fold
from cell.operations.result import FoldResult
from drivers.errors import CellError
from policies.registry import policy_names

FOLDED, SEEN = 0.025, 0.010  # m
STRIPS: dict[str, dict[str, float]] = {
    "short": {"length": 0.1},
    "long": {"length": 2.0},
    "narrow": {"width": 0.002},
    "wide": {"width": 1.0},
    "thick": {"thickness": 0.02},
    "soft": {"bending_length": 0.002},
    "stiff": {"bending_length": 0.2},
    "light": {"areal_density": 0.001},
    "heavy": {"areal_density": 50.0},
    "sluggish": {"retardation_time": 10.0},
}


@dataclass(frozen=True)
class End:
    """How one fold ended; `mark` is empty where that is as it should be."""

    strip: str
    policy: str
    says: str
    mark: str = ""

    def __str__(self) -> str:
        return f"{self.strip:9s} {self.policy:11s} {self.mark:6s} {self.says}"


def tried(folder: Path, strip: str, policy: str) -> End:
    """Fold the extreme strip called `strip` by `policy`, recorded in `folder`."""
    request = Request(
        strip=str(_written(folder, strip)),
        policy=policy,
        checkpoint=None,
        choice=DeviceSelection(),
        runs=folder / "runs",
        configs=None,
        frames="none",
        truth=True,
        viz="off",
    )
    try:
        calibration = calibration_of(find_configs(None).cell())
        result = fold(request, calibration=calibration, page=False)
    except CellError as error:
        return End(strip, policy, f"refused ({error.exit_code}): {error}")
    return _judged(strip, policy, result)


def _judged(strip: str, policy: str, result: FoldResult) -> End:
    seen, true = result.displacement, result.displacement_true
    if result.outcome != "layer_touch":
        mark = "" if result.exit_code > 0 else "UNTRUE"
        return End(strip, policy, f"{result.outcome}: {result.reason}", mark)
    says = f"folded, d {_mm(seen)} (true {_mm(true)})"
    if seen is None or true is None or abs(seen - true) > SEEN:
        return End(strip, policy, says, "UNTRUE")
    return End(strip, policy, says, "" if abs(true) <= FOLDED else "far")


def _mm(value: float | None) -> str:
    return "none" if value is None else f"{1e3 * value:+.1f} mm"


def _written(folder: Path, name: str) -> Path:
    content = yaml.safe_load(find_configs(None).strip_path("denim").read_text(encoding="utf-8"))
    path = folder / f"{name}.yaml"
    path.write_text(yaml.safe_dump({**content, **STRIPS[name], "name": name}), encoding="utf-8")
    return path


def main() -> None:
    """Fold as asked, a line a fold."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--strips", default=",".join(STRIPS))
    parser.add_argument("--policies", default=",".join(policy_names()))
    asked = parser.parse_args()
    bad = 0
    with tempfile.TemporaryDirectory() as folder:
        for strip in asked.strips.split(","):
            for policy in asked.policies.split(","):
                end = tried(Path(folder), strip, policy)
                bad += end.mark == "UNTRUE"
                sys.stdout.write(f"{end}\n")
                sys.stdout.flush()
    sys.exit(1 if bad else 0)


if __name__ == "__main__":
    main()
