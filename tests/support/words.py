"""Words that the house has retired, counted by room, beside the ledger of those that are left.

`python -m tests.support.words` writes the ledger anew, once there are fewer.
"""

import ast
import re
from collections import Counter
from pathlib import Path

import yaml

from tests.support.rooms import inner_room, modules, tree

LEDGER = Path(__file__).parent / "retired_words.yaml"
TOLD = re.compile(r"\b(?:fore)?(?:tells?|told|telling)\b")
PROTOCOL = re.compile(r"[.]tell\(|def tell|[Aa]sk and tell|`tell")  # an optimiser asks and is told
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


def told_lines() -> Counter[str]:
    """Lines by room that hold tell, told, predict or one of their forms."""
    found: Counter[str] = Counter()
    for name, path in modules():
        for line in path.read_text(encoding="utf-8").splitlines():
            found[inner_room(name)] += bool(TOLD.search(line) and not PROTOCOL.search(line))
    return +found


def participles() -> Counter[str]:
    """Functions by room whose name is a participle and nothing else, properties left out."""
    found: Counter[str] = Counter()
    for name, path in modules():
        for node in ast.walk(tree(path)):
            if isinstance(node, ast.FunctionDef) and not _is_property(node):
                found[inner_room(name)] += is_participle(node.name.strip("_"))
    return +found


def is_participle(name: str) -> bool:
    """Whether a function of this name is a bare participle."""
    regular = name.endswith("ed") and name not in NOUNS
    return "_" not in name and (regular or name in IRREGULAR)


def ledger() -> dict[str, dict[str, int]]:
    """The counts that are left, by kind and room."""
    content: dict[str, dict[str, int]] = yaml.safe_load(LEDGER.read_text(encoding="utf-8"))
    return content


def _is_property(node: ast.FunctionDef) -> bool:
    names = {getattr(d, "id", getattr(d, "attr", "")) for d in node.decorator_list}
    return bool(names & {"property", "cached_property"})


def main() -> None:
    """Write the ledger anew, with counts that are at most the old ones."""
    old = ledger() if LEDGER.exists() else {}
    found = {"told": told_lines(), "participles": participles()}
    content = {
        kind: {
            room: min(n, old.get(kind, counts).get(room, n)) for room, n in sorted(counts.items())
        }
        for kind, counts in found.items()
    }
    LEDGER.write_text(yaml.safe_dump(content), encoding="utf-8")


if __name__ == "__main__":
    main()
