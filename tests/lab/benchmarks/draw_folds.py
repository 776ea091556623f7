"""Draws folds as one moving picture: `draw-folds RUN... OUT.webp`.

The films of the runs play side by side from the lift on, cropped to the strip's motion,
each with its name from `--names` and, at the end, the misalignment that the camera
measured.
"""

from itertools import zip_longest
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
    stamps = np.array([f.stamp + begin for f in frames])
    window, images = window_on(run.ticks, calibration), []
    for t in np.arange(0.0, stamps[-1] + PERIOD, PERIOD):
        image = window.crop(
            frames[max(int(np.searchsorted(stamps, t, side="right")) - 1, 0)].image
        )
        image = cv2.resize(
            image, (WIDTH, round(image.shape[0] * WIDTH / image.shape[1]))
        )
        image[:BANNER] //= 4
        d = run.result.displacement if run.result and t >= stamps[-1] else None
        words = "" if d is None else f"misaligned by {abs(1e3 * d):.1f} mm"
        for row, text in enumerate([name, words]):
            place = (10, 22 + 24 * row)
            cv2.putText(image, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.6, WHITE, 1)
        images.append(image)
    return images


def main(
    runs: list[Path],
    out: Path,
    names: Annotated[list[str] | None, typer.Option()] = None,
) -> None:
    """Write the moving picture of the folds in `runs` to `out`."""
    plays = [
        play(run, name)
        for run, name in zip(runs, names or [r.name for r in runs], strict=True)
    ]
    rows = zip_longest(*plays)
    last = [images[-1] for images in plays]
    joined = [
        np.hstack([a if a is not None else b for a, b in zip(row, last, strict=True)])
        for row in rows
    ]
    pictures = [
        Picture.fromarray(np.ascontiguousarray(image[..., ::-1])) for image in joined
    ]
    stays = [round(1e3 * PERIOD)] * (len(pictures) - 1) + [round(1e3 * LAST)]
    more = {
        "append_images": pictures[1:],
        "duration": stays,
        "loop": 0,
        "quality": QUALITY,
    }
    pictures[0].save(out, save_all=True, **more)
    print(f"{out}: {len(pictures)} pictures, {out.stat().st_size / 1e6:.2f} MB")
