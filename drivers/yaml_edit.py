"""Edits YAML files that people write, and keeps their comments, order and notation."""

import io
import re
from collections.abc import Mapping, MutableMapping, MutableSequence, Sequence
from typing import Any

import yaml
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

LINE_WIDTH = 100
INSET = re.compile(r"^  +- ", re.MULTILINE)  # entries of lists stand further in than their key


def edit_text(text: str, content: Mapping[str, Any]) -> str:
    """YAML `text` edited to hold `content`; parts that do not change stay as they are written.

    A text that cannot be edited so is written anew.
    """
    editor = YAML()
    editor.preserve_quotes = True
    editor.width = LINE_WIDTH
    if INSET.search(text):
        editor.indent(mapping=2, sequence=4, offset=2)
    try:
        document = editor.load(text)
        _change(document, content)
        sink = io.StringIO()
        editor.dump(document, sink)
        new = sink.getvalue()
        return new if yaml.safe_load(new) == dict(content) else dump_text(content)
    except (YAMLError, yaml.YAMLError, TypeError, ValueError):
        return dump_text(content)


def dump_text(content: Mapping[str, Any]) -> str:
    """`content` as the text of a new YAML file."""
    return yaml.safe_dump(dict(content), sort_keys=False, allow_unicode=True, width=LINE_WIDTH)


def _change(node: Any, value: Any) -> None:
    """Make the mapping or list `node` hold `value`, touching only what differs."""
    if isinstance(value, Mapping):
        _change_mapping(node, value)
    else:
        _change_list(node, value)


def _change_mapping(node: Any, value: Mapping[str, Any]) -> None:
    _check(node, MutableMapping)
    for key in [key for key in node if key not in value]:
        del node[key]
    for key, item in value.items():
        node[key] = _merge(node.get(key), item)


def _change_list(node: Any, value: Sequence[Any]) -> None:
    _check(node, MutableSequence)
    added = len(value) - len(node)
    if added > 0 and _nearly_equal(node, value[added:], besides=1):
        # new entries in front: the others keep their comments
        for item in reversed(value[:added]):
            node.insert(0, item)
    elif added:
        node[:] = list(value)
    for i, item in enumerate(value):
        node[i] = _merge(node[i], item)


def _nearly_equal(node: Sequence[Any], value: Sequence[Any], besides: int) -> bool:
    """Whether two lists of equal length differ in at most `besides` entries."""
    return len([1 for one, other in zip(node, value, strict=True) if one != other]) <= besides


def _merge(old: Any, new: Any) -> Any:
    """`old` where it equals `new`, changed in place where it can be, or else `new`."""
    if old == new and isinstance(old, bool) == isinstance(new, bool):
        return old
    if isinstance(old, MutableMapping) and isinstance(new, Mapping):
        _change(old, new)
        return old
    if isinstance(old, MutableSequence) and isinstance(new, list | tuple):
        _change(old, new)
        return old
    return new


def _check(node: Any, kind: type) -> None:
    if not isinstance(node, kind):
        raise TypeError(f"is {type(node).__name__}, not {kind.__name__}")
