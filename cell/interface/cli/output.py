"""Output of the commands: streams that never fail, lines of JSON, tables, progress."""

import errno
import io
import json
import os
import select
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from textwrap import wrap
from typing import Any, TextIO, TypeVar

from drivers.base.errors import in_percent

T = TypeVar("T")

INDENT, NO_BREAK = "  ", "\N{NO-BREAK SPACE}"
QUIET = 10.0  # s between two lines on a work where there is no terminal
LEAST_SHARE = 0.05  # of a work, from which on its time left can be told
WIDEST = 1000  # characters of a line, at which the natural width of a table is measured
GONE_ERRNOS = {errno.EPIPE, errno.EBADF, errno.EIO}  # the reader is gone


class Outlet(io.FileIO):
    """Output stream that accepts every byte; `failure` is the first error of writing,
    or None.

    A fold does not end because the reader of its output has gone.
    """

    failure: OSError | None = None

    def write(self, content: Any) -> int:
        """Write what the system accepts, drop the rest after an error; reports all as
        written.
        """
        block = memoryview(content)
        rest = block.cast("B")
        while self.failure is None and rest.nbytes:
            try:
                written = super().write(rest)
                # the pipe would block: wait until its reader makes room
                if written is None:
                    select.select([], [self], [])
                    continue
                rest = rest[written:]
            except OSError as error:
                self.failure = error
        return block.nbytes


def guard_streams() -> Outlet | None:
    """Replace sys.stdout and sys.stderr by streams that never fail; returns that of
    stdout.

    None where a calling program has replaced them already.

    Text that the encoding does not hold is escaped. A descriptor that was closed leads
    to nowhere from now on: else the next file to be opened, a record, would get what is
    printed.
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

    out = Outlet(1, "w", closefd=False)
    sys.stdout = _text_stream(out, sys.stdout)
    sys.stderr = _text_stream(Outlet(2, "w", closefd=False), sys.stderr)
    return out


def _text_stream(outlet: Outlet, before: TextIO | None) -> io.TextIOWrapper:
    """Text stream on `outlet`, like `before`, that escapes what it cannot encode."""
    encoding = getattr(before, "encoding", None) or "utf-8"
    at_once = outlet.isatty() or outlet.fileno() == 2
    return io.TextIOWrapper(
        io.BufferedWriter(outlet), encoding, "backslashreplace", line_buffering=at_once
    )


def why_lost(outlet: Outlet | None) -> str:
    """Reason why printed text was lost; empty where it arrived, or nobody was
    reading.
    """
    if outlet is None or outlet.failure is None or outlet.failure.errno in GONE_ERRNOS:
        return ""
    return outlet.failure.strerror or "no reason given"


def print_json(*objects: Mapping[str, Any]) -> None:
    """Print each of `objects` as one line of JSON, with null for a number that is not
    finite.
    """
    from cell.record.documents import plain

    for facts in objects:
        print(json.dumps(plain(facts)))


def say(facts: Mapping[str, Any], text: str, *, as_json: bool) -> None:
    """Print the result of a command: `facts` as one line of JSON, or else the
    `text`.
    """
    if as_json:
        print_json(facts)
    else:
        print(text)


def notice(text: str) -> None:
    """Print a remark as one line on standard error, apart from the results."""
    print(f"cell: {text}", file=sys.stderr)


@contextmanager
def busy(text: str) -> Iterator[Callable[[str], None]]:
    """Show `text` on a terminal within the block; yields a function that changes the
    text.
    """
    if not sys.stderr.isatty():
        yield lambda _text: None
        return
    from rich.console import Console

    with Console(stderr=True).status(text) as status:
        yield status.update


@contextmanager
def working(
    phase: str, *, quiet: float = QUIET
) -> Iterator[Callable[[str, float], None]]:
    """Show a work's phase, share and time left on one living line within the block.

    Yields a function that is told phase and share. Without a terminal, plain lines are
    written, `quiet` seconds apart or more.
    """
    from cell.base.campaign.progress import duration_text

    began = written = time.monotonic()

    with busy(phase) as show:
        tell = show if sys.stderr.isatty() else notice

        def update(phase: str, share: float) -> None:
            nonlocal written
            now = time.monotonic()
            if tell is notice and now < written + quiet:
                return
            written = now
            left = (now - began) * (1.0 - share) / max(share, LEAST_SHARE)
            known = f", {duration_text(left)} left" if share >= LEAST_SHARE else ""
            tell(f"{phase}  {in_percent(share)}{known}")

        yield update


def while_busy(text: str, items: Iterable[T]) -> Iterator[T]:
    """Yield the `items`, and show `text` on a terminal while the next one is
    computed.
    """
    source = iter(items)
    while True:
        with busy(text):
            try:
                item = next(source)
            except StopIteration:
                return
        yield item


def print_table(
    columns: Sequence[str],
    rows: Sequence[Sequence[str]],
    title: str = "",
    text: int = 1,
) -> None:
    """Print a table of `rows` below `columns`, of which the first `text` hold words.

    Where the terminal is too narrow for the table each row becomes lines of its own:
    the first column, then the others with their names, as many a line as go in.
    """
    from rich.box import HORIZONTALS
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    shown = [[printable(cell) for cell in row] for row in rows]
    table = Table(
        box=HORIZONTALS, show_edge=False, pad_edge=False, collapse_padding=True
    )
    for number, column in enumerate(columns):
        table.add_column(
            column, justify="left" if number < text else "right", no_wrap=True
        )
    for row in shown:
        table.add_row(*map(Text, row))
    console = Console(file=sys.stdout, highlight=False, soft_wrap=False)
    if title:
        print(title)
    options = console.options.update(width=WIDEST)
    if console.measure(table, options=options).maximum <= console.width:
        console.print(table)
        return
    for row in shown:
        print("\n".join(_lines(columns, row, console.width)))


def printable(text: str) -> str:
    """Copy of `text` with control characters of the terminal escaped."""
    return "".join(
        c if c.isprintable() else c.encode("unicode_escape").decode() for c in text
    )


def _lines(columns: Sequence[str], row: Sequence[str], width: int) -> list[str]:
    """Lines for a table row on a narrow terminal: first cell, then named cells,
    wrapped.
    """
    pairs = zip(columns[1:], row[1:], strict=True)
    facts = ", ".join(
        f"{name} {cell}".replace(" ", NO_BREAK) for name, cell in pairs if cell
    )
    room = max(width - len(INDENT), 1)
    wrapped = wrap(facts, room, break_long_words=False, break_on_hyphens=False)
    return [
        row[0],
        *(INDENT + line.rstrip(",").replace(NO_BREAK, " ") for line in wrapped),
    ]
