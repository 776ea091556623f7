"""YAML text: parsing within bounds, dumping, and editing that preserves comments and
order.
"""

import io
import re
from collections.abc import Hashable, Mapping, MutableMapping, MutableSequence, Sequence
from typing import TYPE_CHECKING, Any

import yaml
from yaml.composer import Composer

from drivers.base.errors import ConfigurationError

if TYPE_CHECKING or not yaml.__with_libyaml__:
    _Loader = yaml.SafeLoader
else:

    class _Loader(Composer, yaml.CSafeLoader):
        """YAML parser in C for speed, whose composer in Python does not overflow on
        deep nests.
        """

        def __init__(self, stream: Any) -> None:
            yaml.CSafeLoader.__init__(self, stream)
            Composer.__init__(self)


DEPTH = 32  # of nested lists and mappings
MOST_NODES = 10_000  # with every alias expanded
MOST_DIGITS = 64  # of a number
FLOAT_TAG = "tag:yaml.org,2002:float"
NUMBER_TAGS = ("tag:yaml.org,2002:int", FLOAT_TAG)
# JSON has no such key
KEYLESS_TAGS = ("tag:yaml.org,2002:timestamp", "tag:yaml.org,2002:binary")
# Numbers of YAML 1.2 that are text in YAML 1.1, which PyYAML speaks. Without dot and
# sign few digits are taken: an identifier of 12 digits, one of them an e, is text.
EXPONENTS = re.compile(
    r"[-+]?(?:(?:\d+\.\d*|\.\d+)[eE][-+]?\d+|\d+[eE][-+]\d+|\d{1,7}[eE]\d{1,3})$"
)
LINE_WIDTH = 100
# entries of lists stand further in than their key
INSET = re.compile(r"^  +- ", re.MULTILINE)


def parse_yaml(text: str, path: str) -> dict[str, Any]:
    """Mapping in YAML `text`; raises ConfigurationError, with `path`, for any other
    content.
    """
    try:
        content = yaml.load(text, BoundedLoader)  # noqa: S506  a safe loader, bounded besides
    except yaml.YAMLError as error:
        raise ConfigurationError(
            f"{path}: is not valid YAML: {_place(error)}"
        ) from None
    except (ValueError, RecursionError) as error:
        raise ConfigurationError(f"{path}: is not valid YAML: {error}") from None
    except (AttributeError, LookupError, TypeError, ArithmeticError):
        # what the loader's own constructors raise for `!!timestamp x`, `!!int ""`,
        # `!!bool x`
        raise ConfigurationError(
            f"{path}: is not valid YAML: a value is not what its !! tag says; leave"
            " tags out"
        ) from None
    if not isinstance(content, dict):
        raise ConfigurationError(f"{path}: must be a mapping of keys to values")
    return content


def dump_yaml(content: Mapping[str, Any]) -> str:
    """YAML text of `content`, plain values, from which `parse_yaml` reads an equal
    mapping.
    """
    return yaml.dump(
        dict(content),
        Dumper=_Dumper,
        sort_keys=False,
        allow_unicode=True,
        width=LINE_WIDTH,
    )


def edit_yaml(text: str, content: Mapping[str, Any]) -> str:
    """Edit YAML `text` to hold `content`; unchanged parts keep their layout and
    comments.

    A text that cannot be edited is replaced by `dump_yaml` of `content`.
    """
    from ruamel.yaml import YAML
    from ruamel.yaml.error import YAMLError

    editor = YAML()
    editor.preserve_quotes = True
    editor.width = LINE_WIDTH
    if INSET.search(text):
        editor.indent(mapping=2, sequence=4, offset=2)
    try:
        document = editor.load(text)
        if _edited(document, content) is not document:
            return dump_yaml(content)
        sink = io.StringIO()
        editor.dump(document, sink)
        new = sink.getvalue()
        return new if parse_yaml(new, "") == dict(content) else dump_yaml(content)
    except (YAMLError, ConfigurationError, TypeError, ValueError):
        return dump_yaml(content)


class BoundedLoader(_Loader):
    """Safe YAML loader that refuses duplicate keys and bounds depth, size and digits of
    numbers.

    Size counts expanded aliases; 1e3 is read as a number. Raises yaml.MarkedYAMLError,
    with its line, where a bound is exceeded.
    """

    def __init__(self, stream: Any) -> None:
        super().__init__(stream)
        self._depth = 0
        self._nodes = 0
        self._sizes: dict[str, int] = {}

    def compose_node(self, parent: Any, index: Any) -> Any:
        """Next node of the document; MarkedYAMLError beyond DEPTH or MOST_NODES."""
        event: Any = self.peek_event()  # type: ignore[no-untyped-call]
        if self.check_event(yaml.AliasEvent):
            self._count_alias(event)
            return super().compose_node(parent, index)

        anchor: Any = getattr(event, "anchor", None)
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
        """Next scalar of the document; MarkedYAMLError for a number of more than
        MOST_DIGITS.
        """
        event: Any = self.peek_event()  # type: ignore[no-untyped-call]
        node = super().compose_scalar_node(anchor)
        if node.tag in NUMBER_TAGS and len(node.value) > MOST_DIGITS:
            raise _error_at(
                event, f"is a number of {len(node.value)} digits, at most {MOST_DIGITS}"
            )
        return node

    def construct_mapping(
        self, node: yaml.MappingNode, deep: bool = False
    ) -> dict[Any, Any]:
        """Mapping from `node`; MarkedYAMLError for a key that is no word or is given
        twice.
        """
        seen: set[Hashable] = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode) or key.tag in KEYLESS_TAGS:
                raise _error_at(key, "a key must be a word")
            if key.value in seen:
                raise _error_at(key, f"key {key.value!r} is given twice; keep one")
            seen.add(key.value)
        return super().construct_mapping(node, deep)

    def _count_alias(self, event: Any) -> None:
        """Count an alias as all nodes that it stands for; MarkedYAMLError inside of
        itself.
        """
        anchor = event.anchor
        if anchor in self.anchors and anchor not in self._sizes:
            raise _error_at(
                event, f"alias {anchor!r} stands within what it names; write it out"
            )
        self._count(event, self._sizes.get(anchor, 1))

    def _count(self, event: Any, nodes: int) -> None:
        self._nodes += nodes
        if self._nodes > MOST_NODES:
            raise _error_at(
                event, f"holds more than {MOST_NODES} values, aliases written out"
            )


def _error_at(event: Any, text: str) -> yaml.MarkedYAMLError:
    return yaml.MarkedYAMLError(problem=text, problem_mark=event.start_mark)


class _Dumper(yaml.SafeDumper):
    """Safe dumper that quotes text which `BoundedLoader` would read as a number."""


BoundedLoader.add_implicit_resolver(FLOAT_TAG, EXPONENTS, list("-+.0123456789"))
_Dumper.add_implicit_resolver(FLOAT_TAG, EXPONENTS, list("-+.0123456789"))


def _place(error: yaml.YAMLError) -> str:
    mark = getattr(error, "problem_mark", None)
    problem = getattr(error, "problem", None) or getattr(
        error, "reason", "cannot be parsed"
    )
    return f"line {mark.line + 1}: {problem}" if mark is not None else str(problem)


def _edited(old: Any, new: Any) -> Any:
    """Edit a document's node `old` in place to equal `new` and return it; else return
    `new`.
    """
    if old == new and isinstance(old, bool) == isinstance(new, bool):
        return old
    if isinstance(old, MutableMapping) and isinstance(new, Mapping):
        for key in [key for key in old if key not in new]:
            del old[key]
        for key, item in new.items():
            old[key] = _edited(old.get(key), item)
        return old
    if isinstance(old, MutableSequence) and isinstance(new, list | tuple):
        _edit_list(old, new)
        return old
    return new


def _edit_list(node: Any, value: Sequence[Any]) -> None:
    """Edit the list `node` in place to equal `value`; entries before or after new ones
    stay.
    """
    added = len(value) - len(node)
    if added > 0 and _nearly_equal(node, value[:-added]):
        node.extend(value[-added:])
    elif added > 0 and _nearly_equal(node, value[added:]):
        # new entries in front: the others keep their comments
        for item in reversed(value[:added]):
            node.insert(0, item)
    elif added:
        node[:] = list(value)
    for i, item in enumerate(value):
        node[i] = _edited(node[i], item)


def _nearly_equal(node: Sequence[Any], value: Sequence[Any]) -> bool:
    """Whether two lists of equal length differ in at most one entry."""
    return len([1 for one, other in zip(node, value, strict=True) if one != other]) <= 1
