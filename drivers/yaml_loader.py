"""Safe and strict YAML loader with bounds on depth, size and digits."""

import re
from collections.abc import Hashable
from typing import Any

import yaml

DEPTH = 32  # of nested lists and mappings
MOST_NODES = 10_000  # once every alias is written out
MOST_DIGITS = 64  # of a number
NUMBER_TAGS = ("tag:yaml.org,2002:int", "tag:yaml.org,2002:float")
WORDLESS = ("tag:yaml.org,2002:timestamp", "tag:yaml.org,2002:binary")  # no key in JSON either


class BoundedLoader(yaml.SafeLoader):
    """Safe YAML loader that refuses duplicate keys and bounds depth, size and digits of numbers.

    Size counts aliases written out; 1e-3 is read as a number. Raises yaml.MarkedYAMLError at the
    place where a bound is exceeded.
    """

    def __init__(self, stream: Any) -> None:
        super().__init__(stream)
        self._depth = 0
        self._nodes = 0
        self._sizes: dict[str, int] = {}

    def compose_node(self, parent: Any, index: Any) -> Any:
        """The next node of the document; an alias counts as often as the node it stands for."""
        event: Any = self.peek_event()  # type: ignore[no-untyped-call]
        anchor: Any = getattr(event, "anchor", None)
        if self.check_event(yaml.AliasEvent):
            if anchor in self.anchors and anchor not in self._sizes:
                raise _error_at(
                    event, f"alias {anchor!r} stands within what it names; write it out"
                )
            self._count(event, self._sizes.get(anchor, 1))
            return super().compose_node(parent, index)
        before = self._nodes
        self._count(event, 1)
        self._depth += 1
        if self._depth > DEPTH:
            raise _error_at(event, f"is nested more than {DEPTH} deep")
        node = super().compose_node(parent, index)
        self._depth -= 1
        if anchor is not None:
            self._sizes[anchor] = self._nodes - before
        return node

    def compose_scalar_node(self, anchor: Any) -> Any:
        """The next scalar; a number with too many digits is refused before it is converted."""
        event: Any = self.peek_event()  # type: ignore[no-untyped-call]
        node = super().compose_scalar_node(anchor)
        if node.tag in NUMBER_TAGS and len(node.value) > MOST_DIGITS:
            raise _error_at(
                event, f"is a number of {len(node.value)} digits, at most {MOST_DIGITS}"
            )
        return node

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """Mapping of `node`; MarkedYAMLError for a key that is no word or is given twice."""
        seen: set[Hashable] = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode) or key.tag in WORDLESS:
                problem = "a key must be a word"
                raise yaml.MarkedYAMLError(problem=problem, problem_mark=key.start_mark)
            if key.value in seen:
                problem = f"key {key.value!r} is given twice; keep one"
                raise yaml.MarkedYAMLError(problem=problem, problem_mark=key.start_mark)
            seen.add(key.value)
        return super().construct_mapping(node, deep)

    def _count(self, event: Any, nodes: int) -> None:
        self._nodes += nodes
        if self._nodes > MOST_NODES:
            raise _error_at(event, f"holds more than {MOST_NODES} values, aliases written out")


def _error_at(event: Any, text: str) -> yaml.MarkedYAMLError:
    return yaml.MarkedYAMLError(problem=text, problem_mark=event.start_mark)


# YAML 1.1, which the loader speaks, wants a dot where nobody writes one. The sign stays needed:
# without it an id of digits and an e would be a number.
BoundedLoader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"[-+]?\d+[eE][-+]\d+$"), list("-+0123456789")
)
