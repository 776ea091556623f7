"""Printing of tables on terminals of any width, without breaks inside names and numbers."""

import sys
from collections.abc import Sequence
from shutil import get_terminal_size

COLUMN_GAP = "  "


def print_table(
    columns: Sequence[str], rows: Sequence[Sequence[str]], title: str = "", text: int = 1
) -> None:
    """Print `rows` under `columns`, the first `text` of them words, the others numbers.

    Where the terminal is too narrow for the table each row becomes lines of its own: the first
    column, then the others with their names, as many a line as go in.
    """
    from rich.cells import cell_len

    shown = [[printable(cell) for cell in row] for row in rows]
    widths = [max(map(cell_len, column)) for column in zip(columns, *shown, strict=True)]
    width = sum(widths) + len(COLUMN_GAP) * (len(widths) - 1)
    available = get_terminal_size().columns
    if width > available:
        sys.stdout.write(f"{title}\n" if title else "")
        sys.stdout.writelines("\n".join(_lines(columns, row, available)) + "\n" for row in shown)
        return
    rule = "-" * width + "\n"
    head, *body = (_row(row, widths, text) for row in (columns, *shown))
    sys.stdout.writelines([f"{title}\n" if title else "", rule, head, rule, *body, rule])


def _row(cells: Sequence[str], widths: Sequence[int], text: int) -> str:
    """Line of a table: the first `text` cells to the left, the others to the right."""
    from rich.cells import cell_len

    gaps = [" " * (width - cell_len(cell)) for cell, width in zip(cells, widths, strict=True)]
    words = [cell + gap for cell, gap in zip(cells[:text], gaps, strict=False)]
    numbers = [gap + cell for cell, gap in zip(cells[text:], gaps[text:], strict=True)]
    return COLUMN_GAP.join([*words, *numbers]).rstrip() + "\n"


def printable(text: str) -> str:
    """Escape the terminal control characters in `text`."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def _lines(columns: Sequence[str], row: Sequence[str], width: int) -> list[str]:
    """Lines for one row on a narrow terminal: the first cell, then named cells as they fit."""
    lines = [row[0]]
    current = ""
    for name, cell in zip(columns[1:], row[1:], strict=True):
        if not cell:
            continue
        fact = f"{name} {cell}"
        if current and len(COLUMN_GAP) + len(current) + 2 + len(fact) > width:
            lines.append(COLUMN_GAP + current)
            current = ""
        current = f"{current}, {fact}" if current else fact
    return [*lines, COLUMN_GAP + current] if current else lines
