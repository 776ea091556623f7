"""Draws the rooms and the imports between them: `python -m tests.lab draw-rooms
[OUT.svg]`.

Every room stands on a floor above all rooms that it imports from. Lines that follow
from longer ways are left out.
"""

import ast
import sys
from html import escape
from pathlib import Path
from textwrap import wrap
from typing import Annotated

import typer

from tests.support.rooms import ROOT, Edges, edges, house_room, ladder

OUT = ROOT / "runbooks" / "images" / "rooms.svg"
WIDE, TALL, GAP_X, GAP_Y, EDGE = 176, 68, 26, 56, 24  # px
STYLE = (
    "text{font:13px"
    " system-ui,sans-serif;fill:#22272e}.says{font-size:9.5px;fill:#5b6470}"
    "rect{fill:#f3f6fa;stroke:#2f6db3}path{fill:none;stroke:#9fb3c8;stroke-width:1.1}"
)


def floors(found: Edges) -> list[list[str]]:
    """Rooms by floor, the lowest first."""
    height: dict[str, int] = {}
    for room in ladder(found):
        height[room] = 1 + max((height[other] for other in found[room]), default=-1)
    return [
        sorted(r for r in found if height[r] == level)
        for level in sorted({*height.values()})
    ]


def reduced(found: Edges) -> Edges:
    """Imports between rooms without those implied by a chain of other imports."""

    def below(room: str) -> set[str]:
        return set().union(*({other} | below(other) for other in found[room]))

    return {
        room: others - set().union(*map(below, others))
        for room, others in found.items()
    }


def says(room: str) -> str:
    """First paragraph of a room's docstring, of its package or module."""
    place = ROOT / room.replace(".", "/")
    path = place / "__init__.py" if place.is_dir() else place.with_suffix(".py")
    text = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
    return " ".join(text.partition("\n\n")[0].split())


def drawing(found: Edges) -> str:
    """SVG text of the rooms on floors, a room above all that it imports."""
    storeys = floors(found)[::-1]
    width = max(map(len, storeys)) * (WIDE + GAP_X) + 2 * EDGE - GAP_X
    height = len(storeys) * (TALL + GAP_Y) + 2 * EDGE - GAP_Y
    place = {}
    for row, rooms in enumerate(storeys):
        left = (width - len(rooms) * (WIDE + GAP_X) + GAP_X) / 2
        for column, room in enumerate(rooms):
            place[room] = (left + column * (WIDE + GAP_X), EDGE + row * (TALL + GAP_Y))
    direct = reduced(found)
    arrows = [
        _arrow(place[a], place[b]) for a in sorted(direct) for b in sorted(direct[a])
    ]
    boxes = [_box(room, *place[room]) for room in sorted(found)]
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width}'
        f' {height}"><style>{STYLE}</style><rect width="{width}" height="{height}"'
        f' style="fill:#fff;stroke:none"/>{"".join(arrows)}{"".join(boxes)}</svg>\n'
    )


def _arrow(above: tuple[float, float], below: tuple[float, float]) -> str:
    x, y = above[0] + WIDE / 2, above[1] + TALL
    u, v = below[0] + WIDE / 2, below[1]
    return (
        f'<path d="M{x:.0f} {y:.0f}C{x:.0f} {y + 40:.0f} {u:.0f} {v - 40:.0f} {u:.0f}'
        f' {v:.0f}"/>'
    )


def _box(room: str, x: float, y: float) -> str:
    lines = wrap(says(room), 31)[:4]
    text = "".join(
        f'<text class="says" x="{x + 8:.0f}"'
        f' y="{y + 29 + 11 * i:.0f}">{escape(line)}</text>'
        for i, line in enumerate(lines)
    )
    name = escape(room.replace("cell.", "cell/").replace("__main__", "__main__.py"))
    return (
        f'<rect x="{x:.0f}" y="{y:.0f}" width="{WIDE}" height="{TALL}" rx="6"/>'
        f'<text x="{x + 8:.0f}" y="{y + 16:.0f}" font-weight="600">{name}</text>{text}'
    )


def main(out: Annotated[Path, typer.Argument()] = OUT) -> None:
    """Write the drawing of the rooms to the SVG file `out`."""
    out.write_text(drawing(edges(house_room)), encoding="utf-8")
    sys.stdout.write(f"{out}\n")
