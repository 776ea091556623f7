"""Prints functions and docstrings of the product drawn at random, to be read and marked.

`draw-sample --seed N`: whoever did not write them reads twenty functions of five lines or more and
thirty docstrings, and marks them.
"""

import ast
from collections.abc import Iterator

import numpy as np

from tests.support.rooms import modules

LEAST = 5  # lines of a function worth marking
Function = ast.FunctionDef | ast.AsyncFunctionDef


def functions() -> Iterator[tuple[str, Function, str]]:
    """Name, tree and text of every function of the product, in the order of its modules."""
    for name, path in modules():
        text = path.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, Function):
                yield f"{name}:{node.name}", node, ast.get_source_segment(text, node) or ""


def main(seed: int = 0, count: int = 20, docstrings: int = 30) -> None:
    """Print `count` functions and `docstrings` of public ones, the same for the same seed."""
    found, rng = list(functions()), np.random.default_rng(seed)
    long = [entry for entry in found if len(entry[2].splitlines()) >= LEAST]
    for place in rng.choice(len(long), count, replace=False):
        name, _, text = long[place]
        print(f"==== {name}\n{text}\n")
    public = [(name, node) for name, node, _ in found if not node.name.startswith("_")]
    documented = [(name, text) for name, node in public if (text := ast.get_docstring(node))]
    for place in rng.choice(len(documented), docstrings, replace=False):
        name, text = documented[place]
        print(f"-- {name}\n   {text}\n")
