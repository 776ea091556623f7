"""Mutants made by machine: small changes of code, and a random draw of them."""

import ast
import copy
import hashlib
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import yaml

from tests.lab.mutants import ROOT, Mutant
from tests.support.rooms import imports, modules

# Modules that decide whether, where and how fast the arm moves, and what is believed.
ROOMS = (
    *(
        "cell/orchestrator",
        "cell/folding",
        "cell/setup",
        "cell/folding/feasibility.py",
    ),
    *(
        "drivers/franka",
        "drivers/franka/limits.py",
        "drivers/base/motion.py",
        "calibration",
    ),
    *(
        "cell/perception/model_agreement",
        "cell/perception/camera_watch",
        "cell/perception/perception",
    ),
    *(
        "cell/perception/held_end",
        "cell/perception/laid_fold",
        "cell/perception/layer_touch",
    ),
    *(
        "cell/perception/preflight",
        "cell/perception/resting_strip",
        "cell/perception/image_reader",
    ),
)
IMMATERIAL = Path(__file__).with_name("mutants_immaterial.yaml")
PLACE = re.compile(r":\d+:\d+")  # in a mutant's name
NEAREST = 12  # files of tests that judge a mutant
OPPOSITES = """
    Lt LtE, Lt Gt, LtE Lt, LtE GtE, Gt GtE, Gt Lt, GtE Gt, GtE LtE, Eq NotEq, NotEq Eq, Is IsNot,
    IsNot Is, In NotIn, NotIn In, Add Sub, Sub Add, Mult Div, Div Mult, BitAnd BitOr, BitOr BitAnd,
    And Or, Or And, min max, max min, any all, all any, minimum maximum, maximum minimum
"""
PAIRS = [pair.split() for pair in OPPOSITES.split(",")]
# texts for persons, and places a parser misstates
SILENT = (ast.JoinedStr, ast.Raise, ast.Assert)


def changes(node: ast.AST) -> Iterator[ast.AST]:
    """Nodes that replace an AST node in mutants: errors that programmers make."""
    match node:
        case ast.Compare(ops=[first, *rest]):
            yield from (_with(node, ops=[op, *rest]) for op in _opposites(first))
        case ast.BinOp(op=op) | ast.AugAssign(op=op):
            yield from (_with(node, op=other) for other in _opposites(op))
        case ast.BoolOp(op=op, values=values):
            yield from (_with(node, op=other) for other in _opposites(op))
            yield from values
        case ast.UnaryOp(op=ast.USub() | ast.Not(), operand=operand):
            yield operand
        case ast.Constant(value=bool() | int() | float() as value):
            larger = value + 1 if isinstance(value, int) else 2 * value or 1.0
            yield ast.Constant(not value if isinstance(value, bool) else larger)
        case ast.IfExp(body=body, orelse=orelse):
            yield _with(node, body=orelse, orelse=body)
        case ast.Call(func=ast.Name("abs") | ast.Attribute(attr="abs"), args=[alone]):
            yield alone
        case ast.Name(id=name) | ast.Attribute(attr=name):
            field = "id" if isinstance(node, ast.Name) else "attr"
            yield from (
                _with(node, **{field: other}) for one, other in PAIRS if one == name
            )
        case ast.Expr(value=ast.Call()) | ast.Raise():
            yield ast.Pass()
        case ast.Return(value=value) if value and ast.unparse(value) != "None":
            yield ast.Return(ast.Constant(None))


def _opposites(operator: ast.AST) -> list[ast.AST]:
    return [
        getattr(ast, other)() for one, other in PAIRS if one == type(operator).__name__
    ]


def _with(node: ast.AST, **fields: object) -> ast.AST:
    other = copy.copy(node)
    for name, value in fields.items():
        setattr(other, name, value)
    return other


def _nodes(node: ast.AST, scope: str = "") -> Iterator[tuple[str, ast.AST, ast.AST]]:
    """Function or class, node and what stands in its place, for every change below a
    node.
    """
    yield from ((scope, node, other) for other in changes(node))
    if isinstance(node, ast.If | ast.While):
        yield scope, node.test, ast.UnaryOp(ast.Not(), node.test)
    if isinstance(node, SILENT):
        return
    for name, value in ast.iter_fields(node):
        if name in {"annotation", "returns", "decorator_list", "type_params"}:
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST):
                named = isinstance(child, ast.FunctionDef | ast.ClassDef)
                yield from _nodes(
                    child, f"{scope}.{child.name}".lstrip(".") if named else scope
                )


@cache
def mutants(root: Path, file: str, tests: tuple[str, ...] = ()) -> list[Mutant]:
    """All mutants of `file` below `root`, which `tests` judge, in the order of its
    text.
    """
    text = (root / file).read_text("utf-8")
    starts, found, data = [0], [], text.encode()
    for line in text.splitlines(keepends=True):
        starts.append(starts[-1] + len(line.encode()))
    for scope, node, other in _nodes(ast.parse(text)):
        begin = starts[node.lineno - 1] + node.col_offset
        old = data[begin : starts[node.end_lineno - 1] + node.end_col_offset].decode()
        new = ast.unparse(ast.fix_missing_locations(other))
        new = f"({new})" if isinstance(node, ast.expr) else new
        short = " -> ".join(" ".join(part.split())[:60] for part in (old, new))
        name = f"{file}:{node.lineno}:{node.col_offset} {scope}: {short}"
        found.append(Mutant(name, file, old, new, tests, len(data[:begin].decode())))
    return found


def drawn(count: int, seed: int) -> tuple[Mutant, ...]:
    """`count` mutants of the rooms, from each file in proportion to its mutants and at
    least one.

    A larger `count` by the same `seed` holds the smaller one. Those that IMMATERIAL
    lists are out.
    """
    judged = yaml.safe_load(IMMATERIAL.read_text("utf-8"))
    known = {name for names in judged.values() for name in names}
    every = []
    for name, path in modules():
        file = str(path.relative_to(ROOT))
        if file.startswith(ROOMS) and _lines(path) > 1:
            found = mutants(ROOT, file, judges(name))
            material = [m for m in found if PLACE.sub("", m.name, 1) not in known]
            every.append(sorted(material, key=lambda m: _digest(f"{seed} {m.name}")))
    share = count / max(1, sum(map(len, every)))
    return tuple(
        mutant for here in every for mutant in here[: max(1, round(share * len(here)))]
    )


def _lines(path: Path) -> int:
    return len(path.read_text("utf-8").splitlines())


def _digest(text: str) -> bytes:
    return hashlib.sha256(text.encode()).digest()


@cache
def judges(module: str) -> tuple[str, ...]:
    """Test files that import a module most directly, at most NEAREST, the smallest
    first.
    """
    found, known = dict[str, None](), {module}
    for _ in range(len(modules())):
        found |= {file: None for file, path in _tests() if known & imports(path)}
        more = known | {name for name, path in modules() if known & imports(path)}
        if len(found) >= NEAREST or more == known:
            break
        known = more
    return tuple(found)[:NEAREST]


@cache
def _tests() -> list[tuple[str, Path]]:
    paths = sorted(
        (ROOT / "tests").rglob("test_*.py"), key=lambda path: (_lines(path), path)
    )
    return [(str(path.relative_to(ROOT)), path) for path in paths]
