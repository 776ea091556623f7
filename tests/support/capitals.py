"""Capitals of the house: the kind of value, and the unit, that each constant stands for."""

import ast
import re
from collections import defaultdict
from collections.abc import Iterator

from tests.support.rooms import modules, tree

REGISTRIES = ("CAUSE", "EFFECT", "ENTRY", "LOOK", "SOURCE", "STUDY", "T")  # each in many modules
NODES = {
    ast.Dict: "mapping",
    ast.DictComp: "mapping",
    ast.JoinedStr: "text",
    ast.List: "sequence",
    ast.ListComp: "sequence",
    ast.Set: "set",
    ast.SetComp: "set",
    ast.Tuple: "sequence",
}
CONSTANTS = {bool: "number", bytes: "bytes", float: "number", int: "number", str: "text"}
CALLS = {
    "mapping": "MappingProxyType dict fromkeys",
    "number": "Fraction float int len log radians round sum",
    "path": "FilePath Path resolve with_name with_suffix",
    "sequence": "array empty eye frozen full geomspace linspace list range sorted tuple zeros",
    "set": "frozenset set",
}
CALLED = {name: kind for kind, names in CALLS.items() for name in names.split()}
RANK = ("path", "mapping", "set", "sequence", "text", "number")  # of an operation on two kinds
UNIT = re.compile(
    r"# ((?:1/)?(?:Hz|N|bytes|days|inch|kg|mm|ms|m|ns|px|rad|s)(?:\^\d)?(?:/(?:m|s)(?:\^\d)?)?)"
    r"(?=[\s,;:]|$)"
)
Kinds = dict[str, dict[str, list[str]]]


def ambiguous_capitals() -> Kinds:
    """Names that stand for values of several kinds, or units, each with the modules that say so.

    Registries are left out, and values of which the text does not show the kind; a value is in the
    unit with which the comment behind it begins.
    """
    kinds: Kinds = defaultdict(lambda: defaultdict(list))
    units: Kinds = defaultdict(lambda: defaultdict(list))
    for module, path in modules():
        known: dict[str, str | None] = {}
        lines = path.read_text(encoding="utf-8").splitlines()
        for name, value in _assignments(tree(path)):
            known[name] = kind = kind_of(value, known)
            if kind and name.strip("_").isupper() and name not in REGISTRIES:
                kinds[name][kind].append(module)
                line = lines[value.lineno - 1]
                if line.startswith(f"{name} = ") and (unit := UNIT.search(line)):
                    units[name][unit[1]].append(module)
    return {
        name: all_of
        for found in (kinds, units)
        for name, all_of in found.items()
        if len(all_of) > 1
    }


def kind_of(value: ast.expr, known: dict[str, str | None]) -> str | None:
    """The kind of a value where names stand for kinds that are `known`; None if it is not shown."""
    kind = NODES.get(type(value))
    match value:
        case ast.Constant(value=constant):
            kind = CONSTANTS.get(type(constant))
        case ast.UnaryOp(operand=operand):
            kind = kind_of(operand, known)
        case ast.BinOp(op=ast.Div(), right=ast.Constant(value=str())):
            kind = "path"
        case ast.BinOp(left=left, right=right):
            both = {kind_of(left, known), kind_of(right, known)}
            kind = next((each for each in RANK if each in both), None)
        case ast.Name(id=name):
            kind = known.get(name)
        case ast.Attribute(attr="pi" | "inf" | "nan"):
            kind = "number"
        case ast.Call(func=ast.Name(id=called) | ast.Attribute(attr=called)):
            kind = CALLED.get(called, called if called[0].isupper() else None)
    return kind


def _assignments(module: ast.Module) -> Iterator[tuple[str, ast.expr]]:
    for node in module.body:
        if isinstance(node, ast.Assign):
            for target in node.targets:
                yield from _pairs(target, node.value)
        elif isinstance(node, ast.AnnAssign) and node.value is not None:
            yield from _pairs(node.target, node.value)


def _pairs(target: ast.expr, value: ast.expr) -> Iterator[tuple[str, ast.expr]]:
    if isinstance(target, ast.Name):
        yield target.id, value
    elif isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
        for name, part in zip(target.elts, value.elts, strict=True):
            yield from _pairs(name, part)
