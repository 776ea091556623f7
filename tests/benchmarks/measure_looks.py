"""Folds strips in every look of the cell: a table of what preflight and images made of it.

python -m tests.benchmarks.measure_looks [--looks clutter,flicker] [--strips denim,blanket]
    [--policy feedback] [--out looks.md] [--preflight]

One calibration, made in the plain look, serves all: the camera stays where it is. A refused strip
shows the checks that failed; for a folded one, the seen and the true displacement [mm]. With
--preflight nothing is folded, one picture each is judged.
"""

import argparse
import shutil
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import yaml

from calibration.calibration import Calibration
from calibration.perception.preflight import inspect
from calibration.perception.settings import PerceptionSettings
from cell.config.places import Configs, find_configs
from cell.devices.devices import DeviceSelection
from cell.operations.calibrate import calibration_of
from cell.operations.fold import Request, fold
from cell.operations.result import FoldResult
from drivers.twin.renderer.looks import looks
from drivers.twin.settings import CameraSettings
from tests.support.look_camera import LookCamera
from tests.support.twin_calibration import twin_calibration

ALLOWED = 6.0  # mm of displacement


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--looks", default=",".join(looks()))
    parser.add_argument("--strips", default=",".join(find_configs(None).strip_names()))
    parser.add_argument("--policy", default="feedback")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--preflight", action="store_true")
    return parser.parse_args()


def in_look(configs: Configs, look: str, folder: Path) -> Path:
    """A folder of configurations like `configs`, its twin in `look`."""
    shutil.copytree(configs.folder, folder)
    settings = configs.cell()
    twin = settings.twin.model_copy(update={"look": look})
    content = settings.model_copy(update={"twin": twin}).model_dump(mode="json", by_alias=True)
    (folder / "cell.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    return folder


def folded(look: str, strip: str, policy: str, place: Path, calibration: Calibration) -> FoldResult:
    request = Request(
        strip, policy, None, DeviceSelection(), place / "runs", place / look, "none", True, "off"
    )
    return fold(request, calibration=calibration, page=False)


def told(result: FoldResult) -> str:
    """One field of the table."""
    if result.outcome == "preflight_refused":
        return "refused: " + ", ".join(
            line.split(":")[0] for line in result.reason.splitlines() if "lies there" not in line
        )
    if result.displacement is None or result.displacement_true is None:
        return f"STOPPED: {result.outcome}"
    return f"{1e3 * result.displacement:+.1f} ({1e3 * result.displacement_true:+.1f})"


def good(result: FoldResult) -> bool:
    true = result.displacement_true
    return result.displacement is not None and true is not None and abs(1e3 * true) < ALLOWED


def judged(look: str, name: str) -> str:
    """The checks that refuse the strip in `look`, or that it is admitted."""
    strip, settings = find_configs(None).strip(name), CameraSettings()
    picture = LookCamera(strip, looks()[look], settings).waiting(strip)
    found = inspect(picture, twin_calibration(settings), PerceptionSettings(), strip)
    failed = [check.name for check in found.checks if not check.passed]
    return f"refused: {', '.join(failed)}" if failed else "admitted"


def judge(names: list[str], strips: list[str]) -> None:
    for look in names:
        for strip in strips:
            print(f"{look:13s} {strip:14s} {judged(look, strip)}", flush=True)


def main() -> None:
    asked = arguments()
    if asked.preflight:
        judge(asked.looks.split(","), asked.strips.split(","))
        return
    strips, configs = asked.strips.split(","), find_configs(None)
    lines = [f"| look | {' | '.join(strips)} |", "|---" * (len(strips) + 1) + "|"]
    calibration = calibration_of(configs.cell())
    admitted = bad = 0
    with TemporaryDirectory(prefix="looks-") as name:
        for look in asked.looks.split(","):
            in_look(configs, look, Path(name) / look)
            row = [look]
            for strip in strips:
                result = folded(look, strip, asked.policy, Path(name), calibration)
                row.append(told(result))
                through = result.outcome != "preflight_refused"
                admitted += through
                bad += through and not good(result)
                print(f"{look:13s} {strip:14s} {row[-1]}", flush=True)
            lines.append(f"| {' | '.join(row)} |")
    verdict = f"{admitted} admitted, {bad} of them not within {ALLOWED:.0f} mm"
    text = "\n".join(lines) + f"\n\n{verdict}; seen (true) displacement in mm, {asked.policy}\n"
    print(text)
    if asked.out is not None:
        asked.out.write_text(text, encoding="utf-8")
    sys.exit(1 if bad else 0)


if __name__ == "__main__":
    main()
