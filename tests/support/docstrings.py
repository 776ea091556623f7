"""Public functions whose docstrings leave out the shape of an array or an error that
they raise.
"""

import ast
import re
from collections.abc import Iterator

from tests.support.rooms import ROOT, modules, tree

ARRAYS = re.compile(r"\b(Array|NDArray|Indices|Image|Pixels)\b")
SHAPE = re.compile(r"\((\.\.\.|[a-zA-Z0-9_ +/*.\-]+)?,|scalar|same shape|shape|\(n\)")
RAISES = re.compile(r"\b[Rr]aises?\b|\b[Rr]efuse|Error\b|Fault\b|\b[Rr]efused\b")
Function = ast.FunctionDef | ast.AsyncFunctionDef


def public_functions() -> Iterator[tuple[str, Function, str]]:
    """Place and node of every public function and method of a public class in the
    product, and the docstrings about it.
    """
    for _, path in modules():
        module = tree(path)
        owners = {"": module} | {
            f"{node.name}.": node
            for node in module.body
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
        }
        for name, owner in owners.items():
            about = (ast.get_docstring(owner) or "") if name else ""
            for node in owner.body:
                if isinstance(node, Function) and not node.name.startswith("_"):
                    said = ast.get_docstring(node) or ""
                    place = f"{path.relative_to(ROOT)}:{name}{node.name}"
                    yield place, node, f"{said}\n{about}"


def has_arrays(node: Function) -> bool:
    """Whether an argument or the result is an array."""
    a = node.args
    hints = [x.annotation for x in (*a.posonlyargs, *a.args, *a.kwonlyargs)]
    texts = [ast.unparse(h) for h in (*hints, node.returns) if h is not None]
    return any(ARRAYS.search(text) and "Callable" not in text for text in texts)


def raises(node: Function) -> bool:
    """Whether the function's own body raises a new error."""
    return any(isinstance(n, ast.Raise) and n.exc is not None for n in ast.walk(node))


def shapeless() -> list[str]:
    """Places of functions with arrays that name no shape."""
    return [
        place
        for place, node, said in public_functions()
        if has_arrays(node) and not SHAPE.search(said)
    ]


def silent() -> list[str]:
    """Places of functions that raise and do not say so; a command's errors become its
    lines.
    """
    return [
        place
        for place, node, said in public_functions()
        if raises(node)
        and not RAISES.search(said)
        and not place.startswith("cell/interface/cli/")
    ]
