"""Prints functions and docstrings of the product, drawn at random for a reader:
`draw-sample`.

Whoever did not write them marks twenty functions of five lines or more and thirty
docstrings. By mass a statement is drawn, so that long functions come as often as
reading time goes into them.
"""

import ast
from collections.abc import Iterator

import numpy as np

from tests.support.rooms import modules

LEAST = 5  # lines of a function that is marked


def main(
    seed: int = 0, functions: int = 20, docstrings: int = 30, by_mass: bool = False
) -> None:
    """Print `functions` functions and `docstrings` docstrings, drawn at random by
    `seed`.
    """
    rng = np.random.default_rng(seed)
    found = list(_functions())
    masses = np.array([mass if by_mass else 1.0 for _, mass in found])
    chance = masses / masses.sum()
    drawn = rng.choice(len(found), functions, replace=False, p=chance)
    print(*(found[place][0] for place in drawn), sep="\n")
    said = list(_docstrings())
    drawn = rng.choice(len(said), docstrings, replace=False)
    print(*(said[place] for place in drawn), sep="\n")


def _functions() -> Iterator[tuple[str, int]]:
    """Yield the text of each function under its name, and its number of statements."""
    for name, path in modules():
        text = path.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text)):
            if not isinstance(node, ast.FunctionDef):
                continue
            source = ast.get_source_segment(text, node) or ""
            if len(source.splitlines()) >= LEAST:
                mass = sum(isinstance(part, ast.stmt) for part in ast.walk(node))
                yield f"==== {name}:{node.name}\n{source}\n", mass


def _docstrings() -> Iterator[str]:
    """Yield each docstring under the name of what it describes."""
    for name, path in modules():
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                docstring = ast.get_docstring(node)
                if docstring:
                    yield f"---- {name}:{node.name}\n{docstring}\n"
