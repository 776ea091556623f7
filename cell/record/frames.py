"""Images of a run: choice of those stored, files, index with hashes, writing in a
thread.
"""

import hashlib
import queue
import threading
from collections.abc import Callable
from dataclasses import dataclass
from math import inf, isfinite
from operator import index
from pathlib import Path
from typing import Any

import numpy as np

from cell.record.documents import json_line
from cell.record.events import lift_time
from cell.record.files import FILM, Keep
from cell.record.film import Encoder, RunFilm
from drivers.base.errors import ConfigurationError
from drivers.base.files import new_file, replace_file, write_all
from drivers.base.readers import read_json_lines, read_picture
from drivers.base.types import Frame, Image

FOLDER = "frames"
INDEX = "frames/index.jsonl"
LARGEST_SIDE = 4096  # px of a side
QUEUE = 32  # images of 2.8 MB: at most 90 MB wait for the disk
# waiting images, from which the film goes without, so that files keep theirs
LAGS = QUEUE // 2
KEY_PERIOD = 9.0  # s from one key image to the next, of 1.2 MB each
MOST_KEYS = 32  # key images of a run, beside its last one


@dataclass(frozen=True, slots=True)
class FrameNote:
    """Entry of an image in the index of a run: when it was taken and when it arrived
    [s] and, if it was stored, its file and the SHA-256 digest of its pixels.

    `sha256` is empty for an image that was not stored. `film` is its number in the film
    of the run, None for one that is not in it.
    """

    sequence: int
    stamp: float
    arrival: float
    source: str
    sha256: str
    file: Path | None
    film: int | None = None

    def frame(self, image: Image) -> Frame:
        """The given `image`, of shape (height, width, 3), with the times, the source
        and the number that this entry states.
        """
        return Frame(self.stamp, self.arrival, self.source, self.sequence, image)


def digest(image: Image) -> str:
    """Hexadecimal SHA-256 digest of the pixels of `image`, row by row; its shape is
    (height, width) or (height, width, 3).
    """
    return hashlib.sha256(np.ascontiguousarray(image).data).hexdigest()


def frame_file(folder: Path, sequence: int) -> Path:
    """Path at which the run in `folder` stores the image with the number `sequence`."""
    return folder / FOLDER / f"{sequence:06d}.png"


def encode(image: Image) -> bytes:
    """Content of a PNG file that keeps `image`, of shape (height, width) or (height,
    width, 3), without loss; OSError where that fails.

    On camera noise Huffman coding of differences is the fastest, and within a tenth of
    the smallest.
    """
    import cv2

    options = [
        cv2.IMWRITE_PNG_COMPRESSION,
        1,
        cv2.IMWRITE_PNG_FILTER,
        cv2.IMWRITE_PNG_FILTER_SUB,
    ]
    options += [cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY]
    done, content = cv2.imencode(".png", image, options)
    if not done:
        raise OSError("the image could not be encoded")
    return bytes(content)


def read_index(folder: Path) -> tuple[FrameNote, ...]:
    """Entries of all images of the run in `folder`, of which the latest counts where an
    image has several.

    Raises ConfigurationError for a broken line.
    """
    try:
        lift = lift_time(folder)
        notes = [
            _read_note(folder, line, lift) for line in read_json_lines(folder / INDEX)
        ]
        return tuple({note.sequence: note for note in notes}.values())
    except (KeyError, TypeError, ValueError, OverflowError):
        raise ConfigurationError(
            f"{folder / INDEX}: a line lacks its sequence, stamp or arrival; "
            "it was changed after the run"
        ) from None


def read_frame(note: FrameNote) -> Frame | None:
    """Image to which the entry `note` belongs, or None where it was not stored;
    ConfigurationError where its pixels have changed.
    """
    if note.file is None:
        return None
    image = read_picture(note.file, LARGEST_SIDE)
    if digest(image) != note.sha256:
        raise ConfigurationError(f"{note.file}: is not the image that was recorded")
    return note.frame(image)


def _read_note(folder: Path, line: dict[str, Any], lift: float) -> FrameNote:
    """Entry of an image from the `line` of an index, with times that count from `lift`
    [s] where that is finite; ValueError where the line is broken.
    """
    sequence = index(line["sequence"])
    zero = lift if isfinite(lift) else 0.0
    stamp = float(line["stamp"]) - zero
    arrival = float(line["arrival"]) - zero
    if sequence < 0 or not (isfinite(stamp) and isfinite(arrival)):
        raise ValueError("an image has no number or no time")

    file = frame_file(folder, sequence)
    film = line.get("film")
    return FrameNote(
        sequence,
        stamp,
        arrival,
        source=str(line.get("source", "")),
        sha256=str(line.get("sha256") or ""),
        file=file if file.is_file() else None,
        film=None if film is None else int(film),
    )


class FrameWriter:
    """Writer of the images of a run, in a thread of its own, so that its user learns of
    errors later.

    `patient` makes `put` wait for room: right where the clock is virtual and waiting
    costs the run nothing, wrong on hardware, where an image without room only keeps its
    place in the index.
    """

    def __init__(
        self, folder: Path, keep: Keep, patient: bool, encoder: Encoder | None
    ) -> None:
        """Begin to write images into the run folder `folder` and, unless `encoder` is
        None, as a film as well.
        """
        self._film = encoder and RunFilm(folder / FILM, encoder, patient)
        self._failure: OSError | None = None
        self._given_up = False
        self._folder = folder
        self._keep = keep
        self._patient = patient
        self._keys_left = MOST_KEYS
        self._next_key = -inf  # s
        # if not stored; its place in the film
        self._last: tuple[Frame, int | None] | None = None
        self._waiting: queue.Queue[tuple[Frame, bool] | None] = queue.Queue(QUEUE)
        (folder / FOLDER).mkdir()
        self._index = new_file(folder / INDEX)
        self._thread = threading.Thread(
            target=self._write_queue, name="frames", daemon=True
        )
        self._thread.start()

    def put(self, frame: Frame, mark: bool) -> None:
        """Hand over `frame` to be written; one with a `mark` is stored even where only
        some images are, while fewer than MOST_KEYS are.
        """
        try:
            self._waiting.put((frame, mark), block=self._patient)
        except queue.Full:
            self._note(frame)

    def close(self) -> None:
        """Wait until all images are written, and store the last one; a second call does
        nothing.
        """
        if self._index.closed:
            return
        self._waiting.put(None)
        self._thread.join()
        self._index.close()
        if self._film:
            self._film.close()

    @property
    def film_failure(self) -> str:
        """Reason why the film of the run is incomplete; empty where it is complete or
        there is no film.
        """
        return self._film.failure if self._film else ""

    def take_failure(self) -> OSError | None:
        """Error that writing has met since the last call, or None; once there was one,
        no further image is written.
        """
        failure = self._failure
        self._failure = None
        return failure

    def _write_queue(self) -> None:
        """Write the images that were handed over until the queue ends, and then store
        the last one if only some are stored.
        """
        while (item := self._waiting.get()) is not None:
            self._attempt(self._record, *item)
        if self._keep == "key" and self._last is not None:
            self._attempt(self._store, *self._last)

    def _attempt(self, write: Callable[..., None], *arguments: Any) -> None:
        """Call `write` with the given arguments, unless an earlier call has failed; an
        error is kept for `take_failure`.
        """
        if self._given_up:
            return
        try:
            write(*arguments)
        except OSError as error:
            self._failure = error
            self._given_up = True

    def _record(self, frame: Frame, mark: bool) -> None:
        """Add `frame` to the film, store it if it is one of those to be kept, and note
        it in the index.
        """
        keeps_up = self._patient or self._waiting.qsize() < LAGS
        in_film = None
        if self._film and keeps_up:
            in_film = self._film.put(frame.stamp, frame.image)
        if self._is_kept(frame.stamp, mark):
            self._store(frame, in_film)
            self._last = None
        else:
            self._note(frame, film=in_film)
            self._last = (frame, in_film)

    def _is_kept(self, stamp: float, mark: bool) -> bool:
        """Whether to store the image taken at `stamp` [s]: every image or, where only
        some are kept, those with a `mark` and one in each fixed period.
        """
        if self._keep != "key" or self._keys_left == 0:
            return self._keep == "all"
        is_key = mark or stamp >= self._next_key
        if is_key:
            self._keys_left -= 1
            self._next_key = stamp + KEY_PERIOD
        return is_key

    def _store(self, frame: Frame, film: int | None) -> None:
        """Store `frame` as a file, and note it in the index with the digest of its
        pixels and its number in the `film`.
        """
        replace_file(frame_file(self._folder, frame.sequence), encode(frame.image))
        self._note(frame, sha256=digest(frame.image), film=film)

    def _note(
        self, frame: Frame, sha256: str | None = None, film: int | None = None
    ) -> None:
        """Note `frame` in the index, with the digest `sha256` where it was stored, and
        with its number in the `film` unless that is None.
        """
        note: dict[str, Any] = {
            "sequence": frame.sequence,
            "stamp": frame.stamp,
            "arrival": frame.arrival,
            "source": frame.source,
            "sha256": sha256,
        }
        if film is not None:
            note["film"] = film
        write_all(self._index, json_line(note))
