"""Public functions whose docstrings leave out the shape of an array or an error that
they raise.
"""

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass

from tests.support.rooms import ROOT, modules, tree

ARRAYS = re.compile(r"\b(Array|NDArray|Indices|Image|Pixels)\b")
SHAPE = re.compile(r"\((\.\.\.|[a-zA-Z0-9_ +/*.\-]+)?,|scalar|same shape|shape|\(n\)")
RAISES = re.compile(r"\b[Rr]aises?\b|\b[Rr]efuse|Error\b|Fault\b|\b[Rr]efused\b")
Function = ast.FunctionDef | ast.AsyncFunctionDef


@dataclass(frozen=True)
class Public:
    """Public function or method: its place, syntax node, and the docstrings about
    it.
    """

    place: str
    node: Function
    said: str

    @property
    def has_arrays(self) -> bool:
        """Whether an argument or the result is an array."""
        a = self.node.args
        annotated = [x.annotation for x in (*a.posonlyargs, *a.args, *a.kwonlyargs)]
        hints = [
            ast.unparse(h) for h in (*annotated, self.node.returns) if h is not None
        ]
        return any(ARRAYS.search(hint) and "Callable" not in hint for hint in hints)

    @property
    def raises(self) -> bool:
        """Whether the function's own body raises a new error."""
        return any(
            isinstance(n, ast.Raise) and n.exc is not None for n in ast.walk(self.node)
        )


def public_functions() -> Iterator[Public]:
    """Every public function and method of a public class in the product."""
    for _, path in modules():
        place = path.relative_to(ROOT)
        for node in tree(path).body:
            if isinstance(node, Function) and not node.name.startswith("_"):
                said = ast.get_docstring(node) or ""
                yield Public(f"{place}:{node.name}", node, said)
            elif isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                yield from _methods(node, f"{place}:{node.name}")


def _methods(owner: ast.ClassDef, place: str) -> Iterator[Public]:
    """Public methods of a class, each with the docstring of the class added."""
    whole = ast.get_docstring(owner) or ""
    for node in owner.body:
        if isinstance(node, Function) and not node.name.startswith("_"):
            said = ast.get_docstring(node) or ""
            yield Public(f"{place}.{node.name}", node, f"{said}\n{whole}")


def shapeless() -> list[str]:
    """Places of functions with arrays that name no shape."""
    return [
        p.place for p in public_functions() if p.has_arrays and not SHAPE.search(p.said)
    ]


def silent() -> list[str]:
    """Places of functions that raise and do not say so; a command's errors become its
    lines.
    """
    found = [
        p for p in public_functions() if not p.place.startswith("cell/interface/cli/")
    ]
    return [p.place for p in found if p.raises and not RAISES.search(p.said)]
