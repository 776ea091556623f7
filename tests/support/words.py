"""Words that the house has retired: tell and told, and participles as names of functions."""

import ast
import re

from tests.support.rooms import modules, tree

TOLD = re.compile(r"\b(?:fore)?(?:tells?|told|telling)\b")
ALLOWED = re.compile(  # an optimiser asks and is told, names in files stay, runs cannot tell apart
    r"[.]tell\(|def tell|[Aa]sk and tell|`tell|foretold|told[.]jsonl|cannot tell"
)
IRREGULAR = frozenset(
    [
        "bent",
        "bought",
        "bound",
        "brought",
        "built",
        "caught",
        "cut",
        "done",
        "drawn",
        "driven",
        "felt",
        "found",
        "given",
        "gone",
        "grown",
        "held",
        "hidden",
        "kept",
        "known",
        "laid",
        "learnt",
        "led",
        "left",
        "lost",
        "made",
        "meant",
        "met",
        "paid",
        "put",
        "run",
        "said",
        "seen",
        "sent",
        "set",
        "shown",
        "shut",
        "slept",
        "spent",
        "split",
        "spread",
        "stuck",
        "sworn",
        "taken",
        "taught",
        "thought",
        "told",
        "torn",
        "understood",
        "won",
        "worn",
        "written",
    ]
) - {"cut", "put", "run", "set", "shut", "split", "spread", "left"}  # verbs and nouns as well
NOUNS = frozenset({"speed", "need", "seed", "feed", "embed", "shed", "bed", "red"})


def told_lines() -> list[str]:
    """Lines that hold tell, told or one of their forms."""
    return [
        f"{name}:{number}"
        for name, path in modules()
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1)
        if TOLD.search(line) and not ALLOWED.search(line)
    ]


def participles() -> list[str]:
    """Functions whose name is a participle and nothing else, properties left out."""
    return [
        f"{name}:{node.name}"
        for name, path in modules()
        for node in ast.walk(tree(path))
        if isinstance(node, ast.FunctionDef)
        and is_participle(node.name.strip("_"))
        and not _is_property(node)
    ]


def is_participle(name: str) -> bool:
    """Whether a function of this name is a bare participle."""
    regular = name.endswith("ed") and name not in NOUNS
    return "_" not in name and (regular or name in IRREGULAR)


def _is_property(node: ast.FunctionDef) -> bool:
    names = {getattr(d, "id", getattr(d, "attr", "")) for d in node.decorator_list}
    return bool(names & {"property", "cached_property"})
