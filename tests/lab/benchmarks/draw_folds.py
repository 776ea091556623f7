"""Draws folds as one moving picture: `draw-folds RUN... OUT.webp`.

The films of the runs play side by side in step from the lift on, cropped to the strip's motion,
each with its name from `--names` and, at the end, the misalignment that the camera measured.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import typer
from PIL import Image as Picture

from cell.record.files import FILM
from cell.record.film import Film
from cell.record.run import Run, read_run
from cell.report.overlay import window_on
from drivers.types import Array, Image

PERIOD, LAST = 0.1, 1.5  # s between two pictures, and for which the end stands
WIDTH, BANNER = 480, 56  # px of one fold, and of its text
QUALITY = 55
WHITE = (255, 255, 255)


@dataclass(frozen=True, slots=True)
class Play:
    """Film of one run: stamps (n,) [s] of the run's clock, small images, name and result."""

    stamps: Array
    images: tuple[Image, ...]
    name: str
    result: str

    @classmethod
    def of(cls, run: Run, name: str) -> "Play":
        """The film of `run` from its lift on."""
        calibration = run.calibration()
        if calibration is None:
            raise typer.BadParameter(f"{run.folder} has no calibration")
        begin = next(note.stamp for note in run.frame_index() if note.film == 0)
        window = window_on(run.ticks, calibration)
        frames = [f for f in Film(run.folder / FILM).frames() if f.stamp + begin >= 0]
        d = run.result and run.result.displacement
        text = "" if d is None else f"layers misaligned by {abs(1e3 * d):.1f} mm"
        small = tuple(_small(window.of(frame.image)) for frame in frames)
        return cls(np.array([f.stamp + begin for f in frames]), small, name, text)

    def at(self, time: float) -> Image:
        """Image at `time` [s], or the first or last one; a result once the film is over."""
        place = int(np.searchsorted(self.stamps, time, side="right")) - 1
        image = self.images[max(place, 0)].copy()
        image[:BANNER] //= 4
        for row, text in enumerate([self.name, self.result if time >= self.stamps[-1] else ""]):
            spot = (10, 22 + 24 * row)
            cv2.putText(image, text, spot, cv2.FONT_HERSHEY_SIMPLEX, 0.6, WHITE, 1, cv2.LINE_AA)
        return image


def _small(image: Image) -> Image:
    height = round(image.shape[0] * WIDTH / image.shape[1])
    return cv2.resize(image, (WIDTH, height), interpolation=cv2.INTER_AREA)


def main(
    runs: list[Path], out: Path, names: Annotated[list[str] | None, typer.Option()] = None
) -> None:
    """Write the moving picture of the folds in `runs` to `out`."""
    plays = [
        Play.of(read_run(folder), name)
        for folder, name in zip(runs, names or [run.name for run in runs], strict=True)
    ]
    times = np.arange(0.0, max(play.stamps[-1] for play in plays) + 2 * PERIOD, PERIOD)
    shown = [np.hstack([play.at(t) for play in plays]) for t in times]
    pictures = [Picture.fromarray(np.ascontiguousarray(image[..., ::-1])) for image in shown]
    stays = [round(1e3 * PERIOD)] * (len(pictures) - 1) + [round(1e3 * LAST)]
    more = {"append_images": pictures[1:], "duration": stays, "loop": 0, "quality": QUALITY}
    pictures[0].save(out, save_all=True, **more)
    print(f"{out}: {len(pictures)} pictures, {out.stat().st_size / 1e6:.2f} MB")
