"""Writes images, and a film of them, in separate threads with bounded queues."""

import queue
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from cell.record.files import FILM
from cell.record.film import Encoder
from cell.record.film_encoder import FilmEncoder
from cell.record.frames import FOLDER, INDEX, Keep, KeyFrames, digest, encode, frame_file
from cell.record.json_lines import json_line
from drivers.files import new_file, replace_file, write_all
from drivers.types import Frame

QUEUE = 32  # images of 2.8 MB: at most 90 MB wait for the disk


class FrameWriter:
    """Writes images in its own thread without blocking the caller; reports write errors later.

    `patient` makes `put` wait for room: right where the clock is virtual and waiting costs the run
    nothing, wrong on hardware, where an image without room only keeps its place in the index.
    """

    def __init__(
        self, folder: Path, keep: Keep, patient: bool, encoder: Encoder | None = None
    ) -> None:
        """Write images into `folder`, and with an `encoder` also a film."""
        self.dropped = 0
        self._film = encoder and FilmEncoder(folder / FILM, encoder, patient)
        self._failure: OSError | None = None
        self._given_up = False
        self._folder, self._keep, self._patient = folder, keep, patient
        self._choice = KeyFrames()
        self._last: Frame | None = None
        self._waiting: queue.Queue[tuple[Frame, bool] | None] = queue.Queue(QUEUE)
        (folder / FOLDER).mkdir()
        self._index = new_file(folder / INDEX)
        self._thread = threading.Thread(target=self._drain, name="frames", daemon=True)
        self._thread.start()

    def put(self, frame: Frame, mark: bool) -> None:
        """Queue `frame` for writing; with `mark` it is kept as a key frame."""
        try:
            self._waiting.put((frame, mark), block=self._patient)
        except queue.Full:
            self.dropped += 1
            self._note(frame, sha256=None)

    def close(self) -> None:
        """Wait until all is written; allowed twice. The run's last image is always a key frame."""
        if self._index.closed:
            return
        self._waiting.put(None)
        self._thread.join()
        self._index.close()
        if self._film:
            self._film.close()

    @property
    def film_failure(self) -> str:
        """Reason why the film is incomplete; empty where it is not."""
        return self._film.failure if self._film else ""

    def take_failure(self) -> OSError | None:
        """The write error since the last call, if any; after an error no image is written."""
        failure, self._failure = self._failure, None
        return failure

    def _drain(self) -> None:
        while (item := self._waiting.get()) is not None:
            self._attempt(self._record, *item)
        if self._keep == "key" and self._last is not None:
            self._attempt(self._store, self._last)

    def _attempt(self, write: Callable[..., None], *arguments: Any) -> None:
        """Call `write`, unless an earlier one failed; its error is kept for `take_failure`."""
        if self._given_up:
            return
        try:
            write(*arguments)
        except OSError as error:
            self._failure, self._given_up = error, True

    def _record(self, frame: Frame, mark: bool) -> None:
        place = self._film.put(frame.stamp, frame.image) if self._film else None
        self._note(frame, sha256=digest(frame.image), film=place)
        self._last = frame
        keep, given_up = self._keep == "all", list[int]()
        if self._keep == "key":
            keep, given_up = self._choice.choose(frame.sequence, mark)
        for sequence in given_up:
            frame_file(self._folder, sequence).unlink(missing_ok=True)
        if keep:
            self._store(frame)

    def _store(self, frame: Frame) -> None:
        path = frame_file(self._folder, frame.sequence)
        replace_file(path, encode(frame.image))

    def _note(self, frame: Frame, sha256: str | None, film: int | None = None) -> None:
        note = {"sequence": frame.sequence, "stamp": frame.stamp, "arrival": frame.arrival}
        place = {} if film is None else {"film": film}
        line = json_line({**note, "source": frame.source, "sha256": sha256, **place})
        write_all(self._index, line)
