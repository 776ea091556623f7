"""Encoding of a film in another process, whose threads do not delay those of this process."""

import os
import signal
import struct
from contextlib import suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

from cell.record.film import FilmWriter
from drivers.types import Image

IMAGE_HEADER = struct.Struct("<d3I")  # of an image: stamp [s], height, width, channels
POLITE = 10  # nice value of the encoder
END_MESSAGE = b""  # the message after the last image, and the answer of a film that is whole


class FilmProcess:
    """A `FilmWriter` in another process, which completes its film if this process dies."""

    def __init__(self, path: Path, encoder: str) -> None:
        """Start the process; returns once the film at `path` can take its first image."""
        context = get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(
            target=serve, args=(path, encoder, theirs), name="film", daemon=True
        )
        self._process.start()
        theirs.close()
        self._await_answer()

    def add(self, stamp: float, image: Image) -> None:
        """Add an `image` (h, w, 3) of even sides, taken at `stamp` [s], later than the last one.

        Raises OSError with the reason where the film has broken off.
        """
        try:
            self._pipe.send_bytes(IMAGE_HEADER.pack(stamp, *image.shape))
            self._pipe.send_bytes(np.ascontiguousarray(image).data.cast("B"))
        except OSError:
            self._await_answer()
            raise

    def __enter__(self) -> Self:
        """Return this writer."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Wait until the film is complete."""
        try:
            if kind is None:
                self._pipe.send_bytes(END_MESSAGE)
                self._await_answer()
        finally:
            self._pipe.close()
            self._process.join()

    def _await_answer(self) -> None:
        """Wait for an answer of the process; raises OSError where it failed."""
        try:
            message = self._pipe.recv_bytes()
        except (EOFError, OSError):
            raise OSError("its process has ended") from None
        if message != END_MESSAGE:
            raise OSError(message.decode())


def serve(path: Path, encoder: str, pipe: Connection) -> None:
    """Encode the images that come through `pipe` until the other end closes it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the cell decides when this ends
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    try:
        with FilmWriter(path, encoder) as film, suppress(EOFError, ConnectionResetError):
            pipe.send_bytes(END_MESSAGE)
            os.setpriority(os.PRIO_PROCESS, 0, POLITE)
            while head := pipe.recv_bytes():
                stamp, *shape = IMAGE_HEADER.unpack(head)
                film.add(stamp, np.frombuffer(pipe.recv_bytes(), np.uint8).reshape(shape))
        answer = END_MESSAGE
    except Exception as error:  # noqa: BLE001  an edge: the cell says why the film breaks off
        answer = (str(error) or type(error).__name__).encode()
    with suppress(OSError):
        pipe.send_bytes(answer)
