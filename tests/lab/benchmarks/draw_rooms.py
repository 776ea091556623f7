"""Draws the rooms and the imports between them: `python -m tests.lab draw-rooms
[OUT.svg]`.

Every room stands on a floor above all rooms that it imports from. Lines that follow
from longer ways are left out.
"""

import ast
import sys
from pathlib import Path
from textwrap import wrap
from typing import Annotated

import typer
from matplotlib import rc_context
from matplotlib.figure import Figure

from tests.support.rooms import ROOT, Edges, edges, house_room, ladder

OUT = ROOT / "runbooks" / "images" / "rooms.svg"
BOX = {"boxstyle": "round,pad=0.5", "fc": "#f3f6fa", "ec": "#2f6db3"}
LINE = {"arrowstyle": "-", "color": "#9fb3c8", "connectionstyle": "arc3,rad=0.05"}


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


def main(out: Annotated[Path, typer.Argument()] = OUT) -> None:
    """Write the drawing of the rooms to the SVG file `out`."""
    found = edges(house_room)
    storeys = floors(found)
    widest = max(map(len, storeys))
    place = {
        room: (column - 0.5 * len(rooms), level)
        for level, rooms in enumerate(storeys)
        for column, room in enumerate(rooms)
    }
    figure = Figure(figsize=(2.3 * widest, 1.4 * len(storeys)))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(
        xlim=(-0.5 * widest - 0.5, 0.5 * widest - 0.5), ylim=(-0.5, len(storeys) - 0.5)
    )
    axes.set_axis_off()
    for room, others in reduced(found).items():
        for other in others:
            axes.annotate("", place[other], place[room], arrowprops=LINE)
    for room, at in place.items():
        name = room.replace("cell.", "cell/").replace("__main__", "__main__.py")
        words = "\n".join(wrap(says(room), 34)[:4])
        axes.text(*at, f"{name}\n{words}", bbox=BOX, ha="center", va="center", size=8)
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "rooms"}):
        figure.savefig(out, metadata={"Date": None})
    sys.stdout.write(f"{out}\n")
