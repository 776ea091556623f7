"""Encoding of a run's film during the run, in a thread or in another process."""

import os
import queue
import threading
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Self

from cell.record.film import FilmWriter
from drivers.child import Child, ChildDied, SharedImage
from drivers.types import Image

QUEUE = 16  # images of 2.8 MB: at most 45 MB wait for the encoder
POLITE = 10  # nice value of the encoder
ENCODER_TIMEOUT = 20.0  # s to encode an image, or to complete the film: then the encoder hangs
BREAKS_OFF, HANGS = "the film breaks off", "its encoder hangs"


class FilmEncoder:
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
            self.failure = f"{BREAKS_OFF}: {HANGS}" if self._patient else ""
            return None
        self._count += 1
        return self._count - 1

    def close(self) -> None:
        """Wait until the film is complete, or its encoder hangs."""
        with suppress(queue.Full):
            self._waiting.put(None, timeout=ENCODER_TIMEOUT)
        self._thread.join(ENCODER_TIMEOUT)
        if self._thread.is_alive():
            self.failure = f"{BREAKS_OFF}: {HANGS}"

    def _encode_queue(self, path: Path, encoder: str) -> None:
        writer = FilmWriter if self._patient else FilmProcess
        try:
            with writer(path, encoder) as film:
                self._begun.set()
                while (item := self._waiting.get()) is not None:
                    film.add(*item)
        except Exception as error:  # noqa: BLE001  a film is for eyes: no run ends for its sake
            self.failure = f"{BREAKS_OFF}: {error}"
            self._begun.set()
            while self._waiting.get() is not None:
                pass


@dataclass(frozen=True, slots=True)
class Done:
    """Said by either side: no image follows; the film is open, or has the last image."""


@dataclass(frozen=True, slots=True)
class Add:
    """Message to the encoder: append the shared image, `shape` (h, w, 3), taken at `stamp` [s]."""

    stamp: float
    shape: tuple[int, ...]


class FilmProcess:
    """A `FilmWriter` in another process, which completes its film if this process dies."""

    def __init__(self, path: Path, encoder: str) -> None:
        """Start the process; returns once the film at `path` can take its first image.

        Raises OSError with the reason where it cannot.
        """
        self._image = SharedImage()
        self._child = Child(encode, path, encoder, self._image)
        try:
            self._await_answer()
        except OSError:
            self._close()
            raise

    def add(self, stamp: float, image: Image) -> None:
        """Add an `image` (h, w, 3) of even sides, taken at `stamp` [s], later than the last one.

        Raises OSError with the reason where the film has broken off.
        """
        self._image.write(image)
        self._child.send(Add(stamp, image.shape))
        self._await_answer()

    def __enter__(self) -> Self:
        """Return this writer."""
        return self

    def __exit__(self, error: type[BaseException] | None, *_: object) -> None:
        """Wait until the film is complete; raises OSError with the reason where it is not.

        After an `error` in the block the film has broken off, and that is its reason.
        """
        try:
            if error is None:
                self._child.send(Done())
                self._await_answer()
        finally:
            self._close()

    def _close(self) -> None:
        self._child.close(ENCODER_TIMEOUT)
        self._image.close()

    def _await_answer(self) -> None:
        try:
            answer = self._child.receive(ENCODER_TIMEOUT)
        except ChildDied as died:
            self._child.close()
            known = died.failure
            reason = "its process has ended" if known is None else known.text or known.error
            raise OSError(reason) from None
        if answer is None:
            self._child.kill()
            raise OSError(HANGS)


def encode(pipe: Connection, path: Path, encoder: str, image: SharedImage) -> None:
    """Run in the process: encode each image handed over until the other end closes `pipe`."""
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    with FilmWriter(path, encoder) as film:
        pipe.send(Done())
        os.setpriority(os.PRIO_PROCESS, 0, POLITE)
        while (wanted := _next_image(pipe)) is not None:
            film.add(wanted.stamp, image.read(wanted.shape))
            pipe.send(Done())
    pipe.send(Done())


def _next_image(pipe: Connection) -> Add | None:
    """The next image to encode; None at the end of the film, or of its parent."""
    try:
        wanted = pipe.recv()
    except (EOFError, ConnectionResetError):
        return None
    return wanted if isinstance(wanted, Add) else None
