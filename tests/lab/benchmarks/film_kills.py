"""A run with a film that is killed at a random moment: what of it can be read afterwards?

python -m tests.lab film-kills [--count 40] [--seed 0]

A process records a made fold by the wall clock, a row every 10 ms and an image of 1280 x 720 every
33 ms, and says after each row how many it has written. It is killed somewhere between 0.2 and 6 s
after its first image. Every row that it said to have written must be there, and the film must reach
to within a second of the last image that stands in the index. Exit code 1 where it does not.
"""

import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from cell.record.files import FILM
from cell.record.film import Film
from cell.record.run import read_run
from cell.record.stream import Tick
from cell.record.writer import RunWriter
from drivers.errors import ConfigurationError
from drivers.types import Frame
from tests.cell.conftest import HEADER

ROW, IMAGE = 0.01, 3  # s; rows between two images
LAST = 1.0  # s of a film that may be lost


def record(root: Path) -> None:
    """Record by the wall clock until killed."""
    writer = RunWriter.create(root, HEADER, "key", film="libx264")
    noise = np.random.default_rng(0).integers(90, 110, (8, 720, 1280, 3), np.uint8)
    begun, row = time.monotonic(), 0
    while True:
        t = ROW * row
        writer.tick(Tick(t, 0.6, 0.1, 0.0, 0.6, 0.1, "FOLD"))
        if row % IMAGE == 0:
            image = noise[row // IMAGE % 8].copy()
            image[300:340, (5 * row) % 1200 :][:, :80] = 20
            writer.frame(Frame(t, t, "made", row // IMAGE, image))
        row += 1
        sys.stdout.write(f"{row}\n")
        sys.stdout.flush()
        time.sleep(max(0.0, begun + ROW * row - time.monotonic()))


def kill(after: float, root: Path) -> tuple[int, int, float]:
    """Rows that were said and read, and what the film lacks [s], of a run killed `after` [s]."""
    command = [sys.executable, "-m", "tests.lab", "film-kills", "--record-in", str(root)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        said = process.stdout.readline()
        time.sleep(after)
        process.send_signal(signal.SIGKILL)
        lines = [said, *process.stdout.read().splitlines(keepends=True)]
    written = [int(line) for line in lines if line.endswith("\n")]
    (folder,) = root.iterdir()
    run = read_run(folder)
    notes = run.frame_index()
    filmed = [note for note in notes if note.film is not None]
    try:
        shown = sum(1 for _ in Film(folder / FILM).frames())
    except ConfigurationError:
        shown = 0
    begun = filmed[shown - 1].stamp if shown else notes[0].stamp
    return written[-1], run.ticks.t.size, notes[-1].stamp - begun


def main(count: int = 40, seed: int = 0, record_in: Path | None = None) -> int:
    """Kill so many recordings and print what was lost; or be one of them, in `record_in`."""
    if record_in is not None:
        record(record_in)
    chance, lost, bad = np.random.default_rng(seed), list[float](), 0
    for number in range(count):
        with tempfile.TemporaryDirectory() as root:
            said, read, lacks = kill(chance.uniform(0.2, 6.0), Path(root))
        lost.append(lacks)
        bad += read < said or lacks > LAST
        print(f"{number + 1}: {said} rows said, {read} read, film lacks {1e3 * lacks:.0f} ms")
    print(f"{count} kills, {bad} incomplete; films lack {1e3 * np.median(lost):.0f} ms")
    print(f"in the median, {1e3 * max(lost):.0f} ms at most")
    return int(bad > 0)
