"""Commands of the cell with vivid as its camera, run where vivid is loaded.

`python -m tests.drivers.camera.vivid.commands` prints a line of JSON for each command.
"""

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from tests.drivers.camera.vivid.device import Vivid
from tests.support.assumed_camera import configure


def commands(folder: Path, link: str) -> dict[str, list[str]]:
    """Arguments of `cell` by a name for each."""
    configs, picture = ["--configs", str(folder)], str(folder / "picture.png")
    fold = ["fold", "--camera", "v4l2", "--arm", "twin", "--strip", "denim", "--json", *configs]
    fold += ["--policy", "triangular", "--viz", "off", "--runs", str(folder / "runs")]
    return {
        "list": ["camera"],
        "list as json": ["camera", "--json"],
        "grab": ["camera", "--grab", picture, "--json", *configs],
        "grab by name": ["camera", "--device", link, "--grab", picture],
        "grab of none": ["camera", "--device", "/dev/v4l/by-id/none", "--grab", picture],
        "fold": fold,
    }


def main(wanted: list[str]) -> None:
    """Run the commands, each told in a line."""
    vivid = Vivid()
    folder = Path(tempfile.mkdtemp())
    small = vivid.settings(width=320, height=180, rate=15.0, controls={"brightness": 120})
    configure(folder, small)
    for name, arguments in commands(folder, str(vivid.link)).items():
        if wanted and name not in wanted:
            continue
        command = [sys.executable, "-m", "cell", *arguments]
        begun = time.monotonic()
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        told = {"name": name, "code": done.returncode, "out": done.stdout, "err": done.stderr}
        told["seconds"] = round(time.monotonic() - begun, 1)
        print(json.dumps(told), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
