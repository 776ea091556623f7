"""Commands of an operator on vivid's camera, before which a screen shows pictures.

`python -m tests.drivers.v4l2.vivid.commands VIEWS` prints for each command a line of
JSON with its exit code and what it said. VIEWS is a .npy file (n, 720, 1280, 3) of
views of a board.
"""

import json
import subprocess
import sys
import time
from itertools import cycle
from pathlib import Path
from tempfile import mkdtemp

import numpy as np

from tests.drivers.v4l2.vivid.device import Vivid
from tests.drivers.v4l2.vivid.screen import SIGNAL, filmed_screen

HELD = 1.5  # s for which a person holds the board still
MOVED = 2  # px


def main(views: str) -> None:
    """Calibrate the lens of vivid's camera, and watch it be moved."""
    vivid, images = Vivid(), np.load(views)
    folder = Path(mkdtemp())
    words = _configs(folder, vivid)
    with filmed_screen(vivid) as screen:
        screen.show(images[0])
        check = ("camera", "check", "--view", str(folder / "view.png"), *words)
        _told(check)
        _told(check)
        screen.show(np.roll(images[0], MOVED, axis=1))
        _told(check)
        session = ("--measured", "252mm", "--out", str(folder / "session"))
        wizard = _cell("calibrate", "camera", *session, "--viz", "off", *words)
        wizard.stdin.write("a\n")  # goes on alone
        wizard.stdin.flush()
        for image in cycle(images):
            screen.show(image)
            time.sleep(HELD)
            if wizard.poll() is not None:
                break
        _tell("calibrate", wizard)


def _configs(folder: Path, vivid: Vivid) -> list[str]:
    """Options of a command on a cell whose camera is vivid's."""
    camera = SIGNAL | {"device": str(vivid.link), "stall": 3.0}
    text = Path("configs/cell.yaml").read_text("utf-8")
    (folder / "cell.yaml").write_text(f"{text}camera: {json.dumps(camera)}\n", "utf-8")
    (folder / "strips").symlink_to(Path("configs/strips").resolve())
    return ["--camera", "v4l2", "--configs", str(folder)]


def _cell(*words: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "cell", *words]
    pipe = subprocess.PIPE
    return subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, text=True)


def _told(words: tuple[str, ...]) -> None:
    _tell("check", _cell(*words))


def _tell(name: str, process: subprocess.Popen[str]) -> None:
    said, errors = process.communicate()
    told = {"command": name, "code": process.returncode, "said": said + errors}
    print(json.dumps(told), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
