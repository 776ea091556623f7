"""Prints functions and docstrings of the product, drawn at random for a reader:
`draw-sample`.

Whoever did not write them marks twenty functions of five lines or more and thirty
docstrings.
"""

import ast

import numpy as np

from tests.support.rooms import modules

LEAST = 5  # lines of a function that is marked


def main(seed: int = 0, functions: int = 20, docstrings: int = 30) -> None:
    """Print `functions` functions and `docstrings` docstrings, drawn at random by
    `seed`.
    """
    sources, said, rng = list[str](), list[str](), np.random.default_rng(seed)
    for name, path in modules():
        text = path.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                source = ast.get_source_segment(text, node) or ""
                if (
                    isinstance(node, ast.FunctionDef)
                    and len(source.splitlines()) >= LEAST
                ):
                    sources.append(f"==== {name}:{node.name}\n{source}\n")
                if docstring := ast.get_docstring(node):
                    said.append(f"---- {name}:{node.name}\n{docstring}\n")
    for found, count in ((sources, functions), (said, docstrings)):
        print(
            *(found[place] for place in rng.choice(len(found), count, replace=False)),
            sep="\n",
        )
