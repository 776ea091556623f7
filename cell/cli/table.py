"""Tables on a terminal of any width, without breaks inside names and numbers."""

import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

NARROW = "  "
ROOMY = 10_000  # wider than any table
WIDE = 120  # columns of the widest table


def print_table(
    columns: Sequence[str], rows: Sequence[Sequence[str]], title: str = "", text: int = 1
) -> None:
    """Print `rows` under `columns`, the first `text` of them words, the others numbers.

    Where the terminal is too narrow for the table each row becomes lines of its own: the first
    column, then the others with their names, as many a line as go in.
    """
    from rich.console import Console
    from rich.measure import Measurement

    shown = [[printable(cell) for cell in row] for row in rows]
    console = Console()
    table = _table(columns, shown, title, text)
    roomy = console.options.update(width=ROOMY)
    if Measurement.get(console, roomy, table).minimum <= console.width:
        console.print(table)
        return
    sys.stdout.write(f"{title}\n" if title else "")
    for row in shown:
        sys.stdout.write("\n".join(_lines(columns, row, console.width)) + "\n")


def printable(text: str) -> str:
    """`text` with terminal control characters escaped."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def _table(columns: Sequence[str], rows: Sequence[Sequence[str]], title: str, text: int) -> "Table":
    from rich.table import Table
    from rich.text import Text

    table = Table(title=Text(title, no_wrap=True) if title else None)
    for i, name in enumerate(columns):
        table.add_column(name, justify="left" if i < text else "right", no_wrap=True)
    for row in rows:
        table.add_row(*(Text(cell, no_wrap=True) for cell in row))
    return table


def _lines(columns: Sequence[str], row: Sequence[str], width: int) -> list[str]:
    lines = [row[0]]
    current = ""
    for name, cell in zip(columns[1:], row[1:], strict=True):
        if not cell:
            continue
        fact = f"{name} {cell}"
        if current and len(NARROW) + len(current) + 2 + len(fact) > width:
            lines.append(NARROW + current)
            current = ""
        current = f"{current}, {fact}" if current else fact
    return [*lines, NARROW + current] if current else lines


def wide_console() -> "Console":
    """A console that never wraps a line of a table; a narrower terminal wraps it visibly."""
    from rich.console import Console

    return Console(width=max(Console().width, WIDE))
