"""Films a run in a thread of its own that gives way to every other."""

import os
import queue
import threading
from contextlib import suppress
from pathlib import Path

from cell.record.film import FilmWriter
from drivers.types import Image

QUEUE = 16  # images of 2.8 MB: at most 45 MB wait for the encoder
POLITE = 10  # nice value of the encoder's threads
PATIENCE = 20.0  # s of waiting for an image, after which the encoder hangs
HANGS = "the film breaks off: its encoder hangs"


class FilmThread:
    """Encodes images into the film at `path`; an image that finds no room is left out of it.

    `patient` makes `put` wait for room instead. `failure` says why the film breaks off, if it does:
    no run waits for an encoder that hangs, as SVT-AV1 now and then does.
    """

    def __init__(self, path: Path, encoder: str, patient: bool) -> None:
        self.failure = ""
        self._patient, self._count = patient, 0
        self._waiting: queue.Queue[tuple[float, Image] | None] = queue.Queue(QUEUE)
        self._thread = threading.Thread(
            target=self._work, args=(path, encoder), name="film", daemon=True
        )
        self._thread.start()

    def put(self, stamp: float, image: Image) -> int | None:
        """Film `image` (h, w, 3), taken at `stamp` [s], later than the last one.

        Returns its number in the film, None for an image that is left out.
        """
        if self.failure:
            return None
        try:
            self._waiting.put((stamp, image), self._patient, PATIENCE)
        except queue.Full:
            self.failure = HANGS if self._patient else ""
            return None
        self._count += 1
        return self._count - 1

    def close(self) -> None:
        """Wait until the film is whole, or its encoder hangs."""
        with suppress(queue.Full):
            self._waiting.put(None, timeout=PATIENCE)
        self._thread.join(PATIENCE)
        if self._thread.is_alive():
            self.failure = HANGS

    def _work(self, path: Path, encoder: str) -> None:
        # On Linux a thread has a nice value of its own, which those that it starts inherit.
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), POLITE)
        try:
            with FilmWriter(path, encoder) as film:
                while (item := self._waiting.get()) is not None:
                    film.add(*item)
        except Exception as error:  # noqa: BLE001  a film is for eyes: no run ends for its sake
            self.failure = f"the film breaks off: {error}"
            while self._waiting.get() is not None:
                pass
