"""Draws midlines over photographs: `python -m tests.benchmarks.overlay_yarn DIR OUT.png`."""

import sys
from pathlib import Path

import cv2
import numpy as np

from cell.perception.midline import extract_midline
from drivers.types import Image

TILE = (1100, 330)  # height, width [px]


def overlay(photo: Path) -> Image:
    """One photograph with its midline in red and its ends in green, on a tile."""
    image = cv2.imread(str(photo))
    line = extract_midline(image)
    scale = min(TILE[0] / image.shape[0], TILE[1] / image.shape[1])
    small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    points = np.rint((line.points + 0.5) * scale - 0.5).astype(np.int32)
    cv2.polylines(small, [points.reshape(-1, 1, 2)], False, (0, 0, 255), 1, cv2.LINE_AA)
    for end in (points[0], points[-1]):
        cv2.circle(small, (int(end[0]), int(end[1])), 4, (0, 255, 0), 1, cv2.LINE_AA)
    cv2.putText(small, photo.stem[-4:], (60, 20), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (0, 255, 255))
    tile = np.full((*TILE, 3), 60, dtype=np.uint8)
    tile[: small.shape[0], : small.shape[1]] = small
    return tile


def main(folder: Path, out: Path) -> None:
    """One picture with all photographs of `folder`."""
    photos = sorted(folder.glob("*.jpg"))
    tiles = [overlay(photo) for photo in photos]
    cv2.imwrite(str(out), np.hstack(tiles))
    print(f"{len(tiles)} photographs drawn to {out}")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
