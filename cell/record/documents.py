"""YAML documents and JSON lines that are either whole on the disk or not there."""

import json
import math
import os
from collections.abc import Mapping
from enum import Enum
from io import FileIO
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from drivers.files import MEGABYTE, read_bytes

JOURNAL = 32 * MEGABYTE  # a fold of two minutes writes half of one
LINES = 200_000
DEPTH = 16
DIGITS = 18  # of a whole number that fits 64 bits


def plain(value: object) -> Any:
    """`value` as text, numbers, lists and mappings; a number that is not finite becomes None.

    Raises TypeError for anything that has no plain form.
    """
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.generic | np.ndarray):
        return plain(value.tolist())
    return _scalar(value)


def _scalar(value: object) -> str | int | float | None:
    if isinstance(value, Enum):
        value = value.value
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if value is None or isinstance(value, str | int):
        return value
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"a record cannot hold {type(value).__name__}")


def write_document(path: Path, content: Mapping[str, Any]) -> None:
    """`content` as YAML at `path`, on the disk when this returns, never half of it."""
    text = yaml.safe_dump(plain(content), sort_keys=False, allow_unicode=True, width=100)
    replace_file(path, text.encode(errors="backslashreplace"))


def replace_file(path: Path, content: bytes) -> None:
    """`content` at `path` in one step: a reader sees the old file or the new one."""
    scratch = path.with_name(path.name + ".part")
    try:
        with scratch.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        scratch.replace(path)
    except OSError:
        scratch.unlink(missing_ok=True)
        raise
    sync_folder(path.parent)


def write_all(file: FileIO, content: bytes | memoryview) -> None:
    """All of `content` to the operating system; a full disk may take a part and then refuse."""
    rest = memoryview(content)
    while rest:
        rest = rest[file.write(rest) or 0 :]


def sync_folder(folder: Path) -> None:
    """Make the names in `folder` survive a power cut."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def json_line(content: Mapping[str, Any]) -> bytes:
    """`content` as one line of JSON."""
    text = json.dumps(plain(content), ensure_ascii=False, separators=(", ", ": "))
    return text.encode(errors="backslashreplace") + b"\n"


def read_json_lines(path: Path) -> list[dict[str, Any]]:
    """The whole lines of a JSON lines file; empty without the file.

    What a killed process left half written is passed over. Raises ConfigurationError for what is
    no regular file, or larger than any record.
    """
    if not path.exists():
        return []
    lines: list[dict[str, Any]] = []
    for line in read_bytes(path, JOURNAL).split(b"\n", LINES)[:LINES]:
        try:
            content = json.loads(line, parse_int=_integer)
        except (ValueError, RecursionError):
            continue
        if isinstance(content, dict) and _is_flat(content, DEPTH):
            lines.append(content)
    return lines


def _is_flat(value: object, depth: int) -> bool:
    """Whether lists and mappings are nested no deeper than `depth`."""
    if isinstance(value, dict):
        value = list(value.values())
    if not isinstance(value, list):
        return True
    return depth > 0 and all(_is_flat(item, depth - 1) for item in value)


def _integer(text: str) -> int | float:
    """A whole number; as a float where no index, count or time is so large."""
    return int(text) if len(text) <= DIGITS else float(text)
