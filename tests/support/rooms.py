"""Rooms (packages) of the product and imports between them, read from its source
text.
"""

import ast
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("cell", "policies", "calibration", "drivers")
Edges = dict[str, set[str]]


@cache
def modules() -> tuple[tuple[str, Path], ...]:
    """Every product module by its dotted name."""
    return tuple(
        (_dotted(path), path)
        for package in PACKAGES
        for path in sorted((ROOT / package).rglob("*.py"))
    )


def _dotted(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def tree(path: Path) -> ast.Module:
    """The syntax tree of a module."""
    return ast.parse(text(path))


@cache
def imports(path: Path) -> frozenset[str]:
    """Dotted names that a module imports, those inside functions too."""
    known = {name for name, _ in modules()}
    found: set[str] = set()
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.ImportFrom) and node.module:
            names = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= {name if name in known else node.module for name in names}
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
    return frozenset(name for name in found if name.split(".")[0] in PACKAGES)


def house_room(name: str) -> str:
    """Room of a module: a child package of `cell`, or a top-level package."""
    parts = name.split(".")
    return ".".join(parts[:2]) if parts[0] == "cell" else parts[0]


def inner_room(name: str) -> str:
    """The room of a module to depth two, to depth three within `cell.gap`, where the
    mechanism is a room beside the other subjects.

    A module that lies loose in a package belongs to the package.
    """
    parts = name.split(".")
    depth = 3 if parts[:2] == ["cell", "gap"] else 2
    depth += parts[2:4] == ["subject", "mechanism"]
    room = parts[:depth]
    while len(room) > 1 and not ROOT.joinpath(*room).is_dir():
        room = room[:-1]
    return ".".join(room)


def floor_room(name: str) -> str:
    """The room of a module to depth two, a loose module being a room of its own."""
    room = inner_room(name)
    return name if room in {"calibration", "cell.gap", "drivers", "policies"} else room


def text(path: Path) -> str:
    """The text of a file."""
    return path.read_text(encoding="utf-8")


def edges(room) -> Edges:
    """For each room the other rooms that it imports from."""
    found: Edges = {}
    for name, path in modules():
        here = room(name)
        if here is None or here == "cell":
            continue
        others = {room(other) for other in imports(path)} - {here, None, "cell"}
        found.setdefault(here, set()).update(others)
    return found


def ladder(found: Edges) -> list[str]:
    """The rooms in an order in which each imports only from earlier ones.

    Raises CycleError, a ValueError, naming the rooms of a circle.
    """
    return list(TopologicalSorter(found).static_order())
