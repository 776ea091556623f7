"""Encoding of a run's film in a thread, without delaying the run."""

import queue
import threading
from contextlib import suppress
from pathlib import Path

from cell.record.film import FilmWriter
from cell.record.film_process import FilmProcess
from drivers.types import Image

QUEUE = 16  # images of 2.8 MB: at most 45 MB wait for the encoder
ENCODER_TIMEOUT = 20.0  # s of waiting for an image, after which the encoder hangs
HANGS = "the film breaks off: its encoder hangs"


class FilmThread:
    """Writes a film into the file at `path`; an image for which the queue has no room is left out.

    The encoder has a process of its own, beside a control loop on the wall clock: a thread that
    lost its core while it held the interpreter would hold up the loop. Where the clock is virtual,
    `patient`, it is a thread, and `put` waits for room. `failure` says why the film breaks off, if
    it does: no run waits for an encoder that hangs.
    """

    def __init__(self, path: Path, encoder: str, patient: bool) -> None:
        self.failure = ""
        self._patient, self._count = patient, 0
        self._begun = threading.Event()
        self._waiting: queue.Queue[tuple[float, Image] | None] = queue.Queue(QUEUE)
        self._thread = threading.Thread(
            target=self._encode_queue, args=(path, encoder), name="film", daemon=True
        )
        self._thread.start()
        self._begun.wait(ENCODER_TIMEOUT)

    def put(self, stamp: float, image: Image) -> int | None:
        """Film `image` (h, w, 3), taken at `stamp` [s], later than the last one.

        Returns its number in the film, None for an image that is left out.
        """
        if self.failure:
            return None
        try:
            self._waiting.put((stamp, image), self._patient, ENCODER_TIMEOUT)
        except queue.Full:
            self.failure = HANGS if self._patient else ""
            return None
        self._count += 1
        return self._count - 1

    def close(self) -> None:
        """Wait until the film is complete, or its encoder hangs."""
        with suppress(queue.Full):
            self._waiting.put(None, timeout=ENCODER_TIMEOUT)
        self._thread.join(ENCODER_TIMEOUT)
        if self._thread.is_alive():
            self.failure = HANGS

    def _encode_queue(self, path: Path, encoder: str) -> None:
        writer = FilmWriter if self._patient else FilmProcess
        try:
            with writer(path, encoder) as film:
                self._begun.set()
                while (item := self._waiting.get()) is not None:
                    film.add(*item)
        except Exception as error:  # noqa: BLE001  a film is for eyes: no run ends for its sake
            self.failure = f"the film breaks off: {error}"
            self._begun.set()
            while self._waiting.get() is not None:
                pass
