"""Encoding of a film in another process, whose threads do not delay those of this process."""

import os
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Self

from cell.record.film import FilmWriter
from drivers.child import Child, ChildDied, SharedImage
from drivers.types import Image

POLITE = 10  # nice value of the encoder
ENCODER_TIMEOUT = 20.0  # s to encode an image, or to complete the film


@dataclass(frozen=True, slots=True)
class Ready:
    """Answer of the encoder: the film is open, or the last image is in it."""


@dataclass(frozen=True, slots=True)
class Add:
    """Request to add the shared image, of this `shape` (h, w, 3), taken at `stamp` [s]."""

    stamp: float
    shape: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class End:
    """Request to complete the film."""


class FilmProcess:
    """A `FilmWriter` in another process, which completes its film if this process dies."""

    def __init__(self, path: Path, encoder: str) -> None:
        """Start the process; returns once the film at `path` can take its first image.

        Raises OSError with the reason where it cannot.
        """
        self._image = SharedImage()
        self._child = Child(encode, path, encoder, self._image)
        self._await_answer()

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

    def __exit__(self, *_: object) -> None:
        """Wait until the film is complete; raises OSError with the reason where it is not."""
        try:
            self._child.send(End())
            self._await_answer()
        finally:
            self._child.close(ENCODER_TIMEOUT)
            self._image.close()

    def _await_answer(self) -> None:
        try:
            answer = self._child.receive(ENCODER_TIMEOUT)
        except ChildDied as died:
            known = died.failure
            reason = "its process has ended" if known is None else known.text or known.error
            raise OSError(reason) from None
        if answer is None:
            self._child.kill()
            raise OSError("its encoder hangs")


def encode(pipe: Connection, path: Path, encoder: str, image: SharedImage) -> None:
    """Run in the process: encode each image handed over until the other end closes `pipe`."""
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    with FilmWriter(path, encoder) as film:
        pipe.send(Ready())
        os.setpriority(os.PRIO_PROCESS, 0, POLITE)
        while (wanted := _next_image(pipe)) is not None:
            film.add(wanted.stamp, image.read(wanted.shape))
            pipe.send(Ready())
    pipe.send(Ready())


def _next_image(pipe: Connection) -> Add | None:
    """The next image to encode; None at the end of the film, or of its parent."""
    try:
        wanted = pipe.recv()
    except (EOFError, ConnectionResetError):
        return None
    return wanted if isinstance(wanted, Add) else None
