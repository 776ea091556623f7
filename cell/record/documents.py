"""Writing of a run's YAML documents and lines of JSON, and of an operator's notes on
it.
"""

import json
from collections.abc import Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from pydantic_core import to_jsonable_python

from cell.record.files import NOTES
from cell.record.header import Recorded
from drivers.base.files import change_file, encoded, replace_file
from drivers.base.settings import load, parse
from drivers.base.yaml_text import dump_yaml, parse_yaml


def plain(value: object) -> Any:
    """Convert `value` to text, numbers, lists, mappings; TypeError for other objects.

    A number that is not finite becomes None.
    """
    return to_jsonable_python(value, inf_nan_mode="null", fallback=_plain_array)


def _plain_array(value: Any) -> Any:
    if not hasattr(value, "tolist"):  # of NumPy, whose import commands go without
        raise TypeError(f"a record cannot hold {type(value).__name__}")
    return value.tolist()


def write_document(path: Path, content: Mapping[str, Any]) -> None:
    """Write `content` as YAML to `path` atomically; it is on disk on return."""
    replace_file(path, encoded(dump_yaml(plain(content))))


def json_line(content: Mapping[str, Any]) -> bytes:
    """Encode `content` as one line of JSON."""
    text = json.dumps(plain(content), ensure_ascii=False, separators=(", ", ": "))
    return encoded(text) + b"\n"


class Notes(Recorded):
    """Contents of notes.yaml of a run; `tags` are separated by spaces."""

    tags: str = ""
    note: str = ""


def annotate(
    run: Path,
    add: Iterable[str] = (),
    remove: Iterable[str] = (),
    text: str | None = None,
) -> str:
    """Add tags to the run in the folder `run` and remove others; `text` becomes its
    note.

    Returns the tags, separated by spaces. Raises ConfigurationError, and changes
    nothing, where the notes cannot be read or written.
    """
    path = run / NOTES
    change_file(path, partial(_annotated, path, {*add}, {*remove}, text))
    return load(path, Notes).tags


def _annotated(
    path: Path, add: set[str], remove: set[str], note: str | None, text: str
) -> str:
    """Copy of the notes' `text` with tags added and removed, and another `note` if
    given.
    """
    content = parse_yaml(text, str(path)) if text else {}
    notes = parse(content, Notes, str(path))
    tags = " ".join(sorted({*notes.tags.split(), *add} - remove))
    if note is None:
        note = notes.note
    return dump_yaml({"schema": 1, **content, "tags": tags, "note": note})
