"""Draws a montage of all looks with what is seen in them: `draw_looks.py OUT.png [STRIP]`.

`python -m tests.lab draw-looks runbooks/images/looks.png`. The red line is the profile, the
yellow ring the desk contact; where preflight refuses the strip, the names of the failed checks.
"""

from pathlib import Path

import cv2
import numpy as np
from PIL import Image as Picture

from cell.perception.perception import Perception
from cell.perception.preflight import inspect
from cell.perception.settings import PerceptionSettings
from drivers.strip.describe import load_strip
from drivers.twin.renderer.looks import LOOKS, Look
from drivers.twin.settings import CameraSettings
from drivers.types import Image
from policies.path import triangular
from tests.lab.studies.kit.twin_fold import FoldCamera, TwinFold, simulate_fold
from tests.support.seen_folds import STRIPS
from tests.support.twin_calibration import twin_calibration

CAMERA, SETTINGS = CameraSettings(noise=0.5), PerceptionSettings()
SHOWN = (slice(200, 680), slice(300, 1060))  # rows, columns
TILE = (320, 202)
COLUMNS, COLOURS = 3, 256
SEQUENCE = 250
RED, YELLOW, WHITE, DARK = (40, 40, 230), (0, 230, 255), (255, 255, 255), (40, 40, 40)


def tile(name: str, look: Look, fold: TwinFold) -> Image:
    """One look: its `name`, what is seen of `fold` or why the strip was refused."""
    camera, calibration = FoldCamera(fold.strip, CAMERA, look=look), twin_calibration(CAMERA)
    judged = inspect(camera.flat(fold.strip), calibration, SETTINGS, fold.strip)
    frame = camera.frame(fold, SEQUENCE)
    image = frame.image.copy()
    words = name
    if judged.passed and judged.appearance is not None:
        reader = Perception(calibration, SETTINGS, fold.strip, judged.appearance)
        seen = reader.look(frame, fold.pose(frame.stamp))
        line = np.rint(calibration.to_image(seen.profile)).astype(np.int32)
        cv2.polylines(image, [line.reshape(-1, 1, 2)], False, RED, 1, cv2.LINE_AA)
        place = calibration.to_image(np.array([[seen.contact_x, 0.0]]))[0]
        cv2.circle(image, tuple(np.rint(place).astype(int).tolist()), 8, YELLOW, 2, cv2.LINE_AA)
    else:
        failed = [check.name for check in judged.checks if not check.passed]
        words += f": refused, {failed[0]}"
    small = cv2.resize(image[SHOWN], TILE, interpolation=cv2.INTER_AREA)
    small[:22] = DARK
    cv2.putText(small, words, (6, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.45, WHITE, 1, cv2.LINE_AA)
    return small


def main(out: Path, name: str = "denim") -> None:
    """A picture of few colours, small enough for a runbook."""
    strip = load_strip(STRIPS / f"{name}.yaml")
    fold = simulate_fold(strip, triangular(strip.length), 0.1)
    tiles = [tile(name, look, fold) for name, look in LOOKS.items()]
    tiles += [np.zeros_like(tiles[0])] * (-len(tiles) % COLUMNS)
    rows = [np.hstack(tiles[i : i + COLUMNS]) for i in range(0, len(tiles), COLUMNS)]
    picture = Picture.fromarray(cv2.cvtColor(np.vstack(rows), cv2.COLOR_BGR2RGB))
    picture.quantize(COLOURS, kmeans=4, dither=Picture.Dither.NONE).save(out, optimize=True)
    print(f"{len(LOOKS)} looks drawn to {out}, {out.stat().st_size / 1e3:.0f} kB")
