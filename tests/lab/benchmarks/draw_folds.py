"""Draws folds as one moving picture: `draw-folds RUN... OUT.webp`.

The films of the runs play side by side from the lift on, cropped to the strip's motion,
each with its name from `--names` and, at the end, the misalignment that the camera
measured.
"""

from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import typer
from PIL import Image as Picture

from cell.record.files import FILM
from cell.record.film import Film
from cell.record.run import read_run
from cell.report.overlay import window_on
from drivers.base.types import Image

WHITE = (255, 255, 255)
PERIOD, LAST = 0.1, 1.5  # s between two pictures, and for which the end stands
# px of one fold and of its text; quality of the file
WIDTH, BANNER, QUALITY = 480, 56, 55


def play(folder: Path, name: str) -> list[Image]:
    """Small images of a run's film, one per PERIOD from its lift on, labelled with its
    result.
    """
    run = read_run(folder)
    if (calibration := run.calibration()) is None:
        raise typer.BadParameter(f"{folder} has no calibration")
    begin = next(note.stamp for note in run.frame_index() if note.film == 0)
    frames = [f for f in Film(folder / FILM).frames() if f.stamp + begin >= 0]
    times = np.arange(0.0, frames[-1].stamp + begin + PERIOD, PERIOD)
    shown = np.searchsorted([f.stamp + begin for f in frames], times, side="right") - 1
    window = window_on(run.ticks, calibration)
    cut = [window.crop(frames[max(number, 0)].image) for number in shown]
    size = (WIDTH, round(cut[0].shape[0] * WIDTH / cut[0].shape[1]))
    images = [cv2.resize(image, size) for image in cut]
    for image in images:
        image[:BANNER] //= 4
        _write(image, name, 22)
    if run.result and run.result.displacement is not None:
        d = abs(1e3 * run.result.displacement)
        _write(images[-1], f"misaligned by {d:.1f} mm", 46)
    return images


def _write(image: Image, words: str, row: int) -> None:
    cv2.putText(image, words, (10, row), cv2.FONT_HERSHEY_SIMPLEX, 0.6, WHITE, 1)


def main(
    runs: list[Path],
    out: Path,
    names: Annotated[list[str] | None, typer.Option()] = None,
) -> None:
    """Write the moving picture of the folds in `runs` to `out`."""
    labels = names or [run.name for run in runs]
    plays = [play(run, name) for run, name in zip(runs, labels, strict=True)]
    pictures = []
    for number in range(max(map(len, plays))):
        joined = np.hstack([images[min(number, len(images) - 1)] for images in plays])
        pictures.append(Picture.fromarray(cv2.cvtColor(joined, cv2.COLOR_BGR2RGB)))
    stays = [round(1e3 * PERIOD)] * (len(pictures) - 1) + [round(1e3 * LAST)]
    pictures[0].save(
        out,
        save_all=True,
        append_images=pictures[1:],
        duration=stays,
        loop=0,
        quality=QUALITY,
    )
    print(f"{out}: {len(pictures)} pictures, {out.stat().st_size / 1e6:.2f} MB")
