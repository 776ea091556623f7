"""Prints functions of the product drawn at random, to be read and marked: `draw-sample --seed N`.

Whoever did not write them reads twenty functions of five lines or more, and marks each.
"""

import ast

import numpy as np

from tests.support.rooms import modules

LEAST = 5  # lines of a function that is marked


def main(seed: int = 0, count: int = 20) -> None:
    """Print `count` functions, the same for the same seed."""
    found = []
    for name, path in modules():
        text = path.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                source = ast.get_source_segment(text, node) or ""
                if len(source.splitlines()) >= LEAST:
                    found.append(f"==== {name}:{node.name}\n{source}\n")
    for place in np.random.default_rng(seed).choice(len(found), count, replace=False):
        print(found[place])
