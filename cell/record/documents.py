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
    """Copy of `value` made of text, numbers, lists and mappings alone, as JSON and YAML
    can hold it; TypeError where that is impossible.

    A number that is not finite becomes None.
    """
    return to_jsonable_python(value, inf_nan_mode="null", fallback=_plain_array)


def _plain_array(value: Any) -> Any:
    if not hasattr(value, "tolist"):  # of NumPy, whose import commands go without
        raise TypeError(f"a record cannot hold {type(value).__name__}")
    return value.tolist()


def write_document(path: Path, content: Mapping[str, Any]) -> None:
    """Write `content` as YAML to the file at `path`, which is replaced at once and is
    on the disk when this returns.
    """
    replace_file(path, encoded(dump_yaml(plain(content))))


def json_line(content: Mapping[str, Any]) -> bytes:
    """Bytes of one line of JSON that holds `content`, with the line break
    at its end.
    """
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
    """Add tags to the notes on the run in the folder `run`, remove others, and set the
    note to `text` unless that is None; returns all tags, separated by spaces.

    Raises ConfigurationError, and changes nothing, where the notes cannot be read or
    written.
    """
    path = run / NOTES
    change_file(path, partial(_annotated, path, {*add}, {*remove}, text))
    return load(path, Notes).tags


def _annotated(
    path: Path, add: set[str], remove: set[str], note: str | None, text: str
) -> str:
    """Copy of the `text` of a run's notes with tags added and removed, and with another
    `note` unless that is None.
    """
    content = parse_yaml(text, str(path)) if text else {}
    notes = parse(content, Notes, str(path))
    tags = " ".join(sorted({*notes.tags.split(), *add} - remove))
    if note is None:
        note = notes.note
    return dump_yaml({"schema": 1, **content, "tags": tags, "note": note})
