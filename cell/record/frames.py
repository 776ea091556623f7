"""Images of a run: selection, files, index, hashes."""

import hashlib
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any, Literal

import numpy as np

from cell.record.events import lift_time
from drivers.errors import ConfigurationError
from drivers.readers import read_json_lines
from drivers.types import Frame, Image

Keep = Literal["all", "key", "none"]
FOLDER, INDEX = "frames", "frames/index.jsonl"
LARGEST_SIDE = 4096  # px of a side


@dataclass(frozen=True, slots=True)
class FrameNote:
    """Index entry of a processed image: times [s], sha256 of its pixels, its file if kept.

    `sha256` is empty for an image that was dropped because the disk was too slow. `film` is its
    number in the film of the run, None for one that is not in it.
    """

    sequence: int
    stamp: float
    arrival: float
    source: str
    sha256: str
    file: Path | None
    film: int | None = None


def digest(image: Image) -> str:
    """SHA-256 of the pixels of an image (h, w) or (h, w, 3), row by row."""
    return hashlib.sha256(np.ascontiguousarray(image).data).hexdigest()


def frame_file(folder: Path, sequence: int) -> Path:
    """Path of the image numbered `sequence` of the run in `folder`."""
    return folder / FOLDER / f"{sequence:06d}.png"


def encode(image: Image) -> bytes:
    """Encode `image` (h, w) or (h, w, 3) as lossless PNG; OSError where that fails.

    On camera noise Huffman coding of differences is the fastest, and within a tenth of the
    smallest.
    """
    import cv2

    options = [cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_SUB]
    options += [cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY]
    done, content = cv2.imencode(".png", image, options)
    if not done:
        raise OSError("the image could not be encoded")
    return bytes(content)


def decode(path: Path) -> Image:
    """Read the image (h, w, 3) in the file at `path`; ConfigurationError for any other file."""
    from drivers.readers import read_picture

    return read_picture(path, LARGEST_SIDE)


class KeyFrames:
    """Selects about ten images of a run of unknown length: marked ones, and some evenly spread.

    It starts with every `stride`-th image; whenever they become too many, every second one is
    dropped.
    """

    def __init__(self, spread: int = 8, marked: int = 8, stride: int = 8) -> None:
        self._limit = spread
        self._marks_left = marked
        self._stride = stride
        self._spread: list[tuple[int, int]] = []  # number in the run, and sequence number
        self._count = 0

    def choose(self, sequence: int, mark: bool) -> tuple[bool, list[int]]:
        """Whether to keep the next image, and the sequence numbers of kept images to drop now."""
        number, self._count = self._count, self._count + 1
        if mark and self._marks_left > 0:
            self._marks_left -= 1
            return True, []
        if number % self._stride:
            return False, []
        self._spread.append((number, sequence))
        if len(self._spread) <= self._limit:
            return True, []
        self._stride *= 2
        surplus = [kept for place, kept in self._spread if place % self._stride]
        self._spread = [each for each in self._spread if each[0] % self._stride == 0]
        return sequence not in surplus, [kept for kept in surplus if kept != sequence]


def read_index(folder: Path) -> tuple[FrameNote, ...]:
    """Read the index of the images in `folder`, in order; ConfigurationError for a broken line."""
    try:
        lift = lift_time(folder)
        return tuple(_note(folder, line, lift) for line in read_json_lines(folder / INDEX))
    except (KeyError, TypeError, ValueError, OverflowError):
        raise ConfigurationError(
            f"{folder / INDEX}: a line lacks its sequence, stamp or arrival; "
            "it was changed after the run"
        ) from None


def read_frame(note: FrameNote) -> Frame | None:
    """Read the image (h, w, 3) of an index entry; None where it was not kept.

    Raises ConfigurationError for an image that cannot be read or differs from the recorded one.
    """
    if note.file is None:
        return None
    image = decode(note.file)
    if digest(image) != note.sha256:
        raise ConfigurationError(f"{note.file}: is not the image that was recorded")
    return Frame(note.stamp, note.arrival, note.source, note.sequence, image)


def _note(folder: Path, line: dict[str, Any], lift: float) -> FrameNote:
    sequence, stamp, arrival = int(line["sequence"]), float(line["stamp"]), float(line["arrival"])
    if isfinite(lift):
        stamp, arrival = stamp - lift, arrival - lift
    if sequence < 0 or not (isfinite(stamp) and isfinite(arrival)):
        raise ValueError("an image has no number or no time")
    path = frame_file(folder, sequence)
    return FrameNote(
        sequence=sequence,
        stamp=stamp,
        arrival=arrival,
        source=str(line.get("source", "")),
        sha256=str(line.get("sha256") or ""),
        file=path if path.is_file() else None,
        film=None if line.get("film") is None else int(line["film"]),
    )
