"""Pictures of recordings in Rerun's own viewer, on a screen that nobody sees."""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from itertools import takewhile
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np

from cell.record.run import read_run
from cell.report.viz.opening import open_recording
from cell.report.viz.playback import LogLine, TickView, moments_of
from cell.report.viz.recording import RerunWriter, layout
from drivers.base.readers import read_yaml
from drivers.base.settings import parse
from drivers.base.types import Image
from drivers.strip.file import StripFile

XVFB = shutil.which("xvfb-run")
DRIVERS = Path("/usr/share/vulkan/icd.d")
FOUND = XVFB is not None and any(DRIVERS.glob("*.json"))
SIZE = "1600x900"  # px of the window; half of those of the picture
# the pointer stands amid the screen: off the window
SCREEN = "-screen 0 3800x1790x24"
TIMEOUT = 240  # s
# left, top, right, bottom in shares of the picture, by what a run shows there
PLACES = read_yaml(Path(__file__).with_suffix(".yaml"))


def picture(recording: Path, out: Path) -> Image:
    """Picture (h, w, 3) of how the viewer opens a `recording`, written to the PNG
    `out`.
    """
    command = [str(XVFB), "-a", "-s", SCREEN, sys.executable, "-m", "rerun_cli"]
    command += [str(recording), "--screenshot-to", str(out), "--window-size", SIZE]
    with TemporaryDirectory() as home:
        environment = {**os.environ, "HOME": home, "XDG_CONFIG_HOME": home}
        quiet = ["analytics", "disable"]
        subprocess.run(
            [sys.executable, "-m", "rerun_cli", *quiet],
            env=environment,
            capture_output=True,
            check=False,
        )
        done = subprocess.run(
            command, env=environment, capture_output=True, timeout=TIMEOUT, check=False
        )
    if not out.is_file():
        raise RuntimeError(done.stderr.decode()[-2000:])
    return np.asarray(cv2.imread(str(out)))


def recording_until(folder: Path, end: float, out: Path) -> Path:
    """Recording of the run in `folder` up to time `end` [s], where it opens, as a live
    view shows it then.
    """
    run = read_run(folder)
    strip = parse(run.header.strip_file or {}, StripFile, "strip_file")
    views = layout(strip, run.calibration(), end=end, live=True)
    with open_recording("cell", out, views) as recording:
        screen = RerunWriter(recording, run.calibration(), strip, batch=np.inf)
        screen.begin(run)
        for item in _until(moments_of(run), end):
            screen.draw(item)
        screen.finish(run)
    return out


def cut(image: Image, place: str) -> Image:
    """Part of a picture of a run at one of PLACES."""
    height, width = image.shape[:2]
    left, top, right, bottom = PLACES[place]
    rows = slice(round(top * height), round(bottom * height))
    return image[rows, round(left * width) : round(right * width)]


def _until(
    items: Iterator[TickView | LogLine], end: float
) -> Iterator[TickView | LogLine]:
    return takewhile(lambda item: not item.t > end, items)
