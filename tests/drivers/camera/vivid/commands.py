"""Commands of the cell with vivid as its camera, run where vivid is loaded.

`python -m tests.drivers.camera.vivid.commands` prints a line of JSON for each command.
"""

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import yaml

from calibration.calibration import calibrated, save_calibration
from calibration.homography import Homography
from calibration.lens import Lens
from drivers.camera.settings import V4l2Settings
from tests.drivers.camera.machine import CHECKOUT
from tests.drivers.camera.vivid.device import Vivid

DATE = "2026-01-01T00:00:00+00:00"
SCALE = 700.0  # px/m of a camera that looks straight at the plane


def configure(folder: Path, camera: V4l2Settings) -> None:
    """A copy of the packaged configuration whose camera is `camera`, calibrated by assumption."""
    plain = yaml.safe_load((CHECKOUT / "configs" / "cell.yaml").read_text())
    plain["camera"] = camera.model_dump(exclude_defaults=True)
    plain["calibration"] = "assumed.yaml"
    (folder / "cell.yaml").write_text(yaml.safe_dump(plain))
    (folder / "strips").symlink_to(CHECKOUT / "configs" / "strips")
    save_calibration(_assumed(camera), folder / "assumed.yaml")


def _assumed(camera: V4l2Settings):
    width, height = camera.width, camera.height
    matrix = np.array([[1600.0, 0, width / 2], [0, 1600.0, height / 2], [0, 0, 1]])
    lens = Lens(width=width, height=height, matrix=matrix, distortion=np.zeros(5))
    upright = np.array([[1 / SCALE, 0, -0.1], [0, -1 / SCALE, 0.4], [0, 0, 1]])
    return calibrated(
        lens, Homography.of(upright), residual_mm=0.3, date=DATE, camera=camera.identity
    )


def main() -> None:
    """Run the commands, each told in a line."""
    vivid = Vivid()
    folder = Path(tempfile.mkdtemp())
    configure(folder, vivid.settings(controls={"brightness": 120}))
    link, configs = str(vivid.link), ["--configs", str(folder)]
    picture = str(folder / "picture.png")
    fold = ["fold", "--camera", "v4l2", "--arm", "twin", "--strip", "denim", "--json"]
    fold += [*configs, "--policy", "triangular", "--viz", "off", "--runs", str(folder / "runs")]
    for command in (
        ["camera"],
        ["camera", "--json"],
        ["camera", "--grab", picture, "--json", *configs],
        ["camera", "--device", link, "--grab", picture],
        ["camera", "--device", "/dev/v4l/by-id/none", "--grab", picture],
        fold,
    ):
        if sys.argv[1:] and command[0] not in sys.argv[1:]:
            continue
        begun = time.monotonic()
        done = subprocess.run(
            [sys.executable, "-m", "cell", *command], capture_output=True, text=True, check=False
        )
        told = {"command": command, "code": done.returncode, "out": done.stdout}
        told |= {"err": done.stderr, "seconds": round(time.monotonic() - begun, 1)}
        print(json.dumps(told), flush=True)


if __name__ == "__main__":
    main()
