"""Robust standard output and error: a closed or full terminal never fails a command."""

import errno
import io
import os
import select
import sys
from contextlib import suppress
from typing import Any, TextIO

GONE_ERRNOS = {errno.EPIPE, errno.EBADF, errno.EIO}  # the reader is gone


class Outlet(io.FileIO):
    """File that accepts every byte; `failure` is the system's error for the first one refused.

    A fold does not end, and its exit code does not change, because the reader of its output has
    gone.
    """

    failure: OSError | None = None

    def write(self, content: Any) -> int:
        """Write what the system accepts, drop the rest after an error; always claims every byte."""
        block = memoryview(content)
        rest = block.cast("B")
        while self.failure is None and rest.nbytes:
            try:
                written = super().write(rest)
                if written is None:  # the pipe would block: wait until its reader makes room
                    select.select([], [self], [])
                    continue
                rest = rest[written:]
            except OSError as error:
                self.failure = error
        return block.nbytes


def guard_streams() -> Outlet | None:
    """Replace sys.stdout and sys.stderr by streams that never fail; returns that of stdout.

    None where a calling program has replaced them already.

    Text that the encoding does not hold is escaped. A descriptor that was closed leads to
    nowhere from now on: else the next file to be opened, a record, would get what is printed.
    """
    if sys.stdout is not sys.__stdout__ or sys.stderr is not sys.__stderr__:
        return None
    for descriptor in (0, 1, 2):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the lowest one free, which is this
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):
            print(end="", file=stream, flush=True)
    out, err = Outlet(1, "w", closefd=False), Outlet(2, "w", closefd=False)
    sys.stdout, sys.stderr = _text_stream(out, sys.stdout), _text_stream(err, sys.stderr)
    return out


def _text_stream(outlet: Outlet, before: TextIO | None) -> io.TextIOWrapper:
    """A stream like `before` that escapes what it cannot encode."""
    encoding = getattr(before, "encoding", None) or "utf-8"
    at_once = outlet.isatty() or outlet.fileno() == 2
    return io.TextIOWrapper(
        io.BufferedWriter(outlet), encoding, "backslashreplace", line_buffering=at_once
    )


def why_lost(outlet: Outlet | None) -> str:
    """Reason why the printed text did not arrive; empty where it did or nobody was reading."""
    if outlet is None or outlet.failure is None or outlet.failure.errno in GONE_ERRNOS:
        return ""
    return outlet.failure.strerror or "no reason given"
