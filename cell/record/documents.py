"""Atomic writing of YAML documents and other files."""

import math
import os
from collections.abc import Mapping
from enum import Enum
from io import FileIO
from pathlib import Path
from typing import Any

import numpy as np
import yaml


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
    """Write `content` as YAML to `path` atomically; it is on disk on return."""
    text = yaml.safe_dump(plain(content), sort_keys=False, allow_unicode=True, width=100)
    replace_file(path, text.encode(errors="backslashreplace"))


def replace_file(path: Path, content: bytes) -> None:
    """Replace the file at `path` by `content` atomically: a reader sees the old
    file or the new one.
    """
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
    """Write all of `content`, repeating partial writes; raises OSError when the system refuses."""
    rest = memoryview(content)
    while rest:
        rest = rest[file.write(rest) or 0 :]


def sync_folder(folder: Path) -> None:
    """Flush the directory entries of `folder` to disk."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
