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
