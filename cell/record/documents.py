"""Conversion of a record's values to plain Python values, to YAML documents and lines of JSON."""

import json
import math
from collections.abc import Mapping
from enum import Enum
from pathlib import Path
from typing import Any

from drivers.files import replace_file
from drivers.yaml_text import dump_yaml


def plain(value: object) -> Any:
    """Convert `value` to text, numbers, lists and mappings; a non-finite number becomes None.

    Raises TypeError for anything that has no plain form.
    """
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if hasattr(value, "tolist"):  # a number or an array of NumPy, whose import commands go without
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
    replace_file(path, dump_yaml(plain(content)).encode(errors="backslashreplace"))


def json_line(content: Mapping[str, Any]) -> bytes:
    """Encode `content` as one line of JSON."""
    text = json.dumps(plain(content), ensure_ascii=False, separators=(", ", ": "))
    return text.encode(errors="backslashreplace") + b"\n"
