"""Edits of strip files that keep a person's formatting where nothing changes."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from cell.record.documents import replace_file
from drivers.errors import ConfigurationError
from drivers.settings import parse
from drivers.strip.file import StripFile


def with_measured(
    content: Mapping[str, Any], key: str, value: float, source: str, note: str
) -> dict[str, Any]:
    """`content` of a strip file with `key` measured; the old value stays in its provenance."""
    kept = [dict(each) for each in content.get("provenance") or ()]
    for entry in kept:
        if entry.get("key") == key:
            entry["note"] = f"until then {content[key]:g}; {entry.get('note', '')}".strip("; ")
    measured = {"key": key, "source": source, "note": note}
    return {**content, key: value, "provenance": [measured, *kept]}


def edited(text: str, content: Mapping[str, Any]) -> str:
    """`text` of a YAML file changed to `content`: only changed keys are rewritten, if possible."""
    old = yaml.safe_load(text)
    new = text
    for key, value in content.items():
        if old.get(key) != value:
            new = _with_key(new, key, value)
    return new if _says(new, content) else _dumped(content)


def rewrite(path: Path, content: Mapping[str, Any]) -> None:
    """Replace the strip file at `path` by `content`, checked, atomically; or ConfigurationError."""
    parse(content, StripFile, str(path))
    try:
        replace_file(path, edited(path.read_text(encoding="utf-8"), content).encode())
    except OSError as error:
        raise ConfigurationError(f"{path}: cannot be written: {error.strerror}") from None


def create(path: Path, content: Mapping[str, Any]) -> None:
    """Write a new strip file at `path`, checked; an existing one is refused."""
    parse(content, StripFile, str(path))
    if path.exists():
        raise ConfigurationError(f"{path}: is there already; choose another name or edit the file")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        replace_file(path, _dumped(content).encode())
    except OSError as error:
        raise ConfigurationError(f"{path}: cannot be written: {error.strerror}") from None


def _with_key(text: str, key: str, value: object) -> str:
    """`text` with the block of a top-level `key` replaced, or added at the end."""
    if isinstance(value, float | int):
        scalar = re.compile(rf"^({re.escape(key)}\s*:\s*)[^\s#]+", re.MULTILINE)
        return scalar.sub(lambda found: f"{found[1]}{value!r}", text, count=1)
    block = re.compile(rf"^{re.escape(key)}\s*:.*\n(?:[ \-].*\n|\s*\n)*", re.MULTILINE)
    whole = text if text.endswith("\n") else text + "\n"
    dumped = _dumped({key: value})
    if block.search(whole) is None:
        return whole + dumped
    return block.sub(lambda _: dumped, whole, count=1)


def _says(text: str, content: Mapping[str, Any]) -> bool:
    try:
        return bool(yaml.safe_load(text) == dict(content))
    except yaml.YAMLError:
        return False


def _dumped(content: Mapping[str, Any]) -> str:
    return yaml.safe_dump(dict(content), sort_keys=False, allow_unicode=True, width=100)


SOURCED = ("areal_density", "bending_length", "retardation_time", "thickness")
ASSUMED = {
    "areal_density": 0.2,  # kg/m^2, a shirting
    "bending_length": 0.020,  # m, the middle of what fabrics have
    "retardation_time": 0.05,  # s; nobody publishes it
    "thickness": 0.001,  # m
}


def new_strip(
    path: Path, stated: Mapping[str, Any], colour: Sequence[int] | None, sources: Sequence[str]
) -> None:
    """A strip file at `path`; `stated` values may be None, `sources` read `key=where from`.

    Raises ConfigurationError for a source without its value.
    """
    told = dict(_source(each) for each in sources)
    for key in told:
        if stated.get(key) is None:
            raise ConfigurationError(f"--source: {key}: give its value too")
    content: dict[str, Any] = {"schema": 1, "name": path.stem}
    content |= {key: ASSUMED[key] if value is None else value for key, value in stated.items()}
    if colour is not None:
        content["colour"] = list(colour)
    content["provenance"] = [
        {"key": key, "source": told.get(key, "assumed" if stated[key] is None else "measured")}
        for key in SOURCED
    ]
    create(path, content)


def _source(text: str) -> tuple[str, str]:
    key, equals, source = text.partition("=")
    if not equals or key not in SOURCED or not source.strip():
        raise ConfigurationError(
            f"--source: {text!r} is not KEY=TEXT; KEY is one of {', '.join(SOURCED)}"
        )
    return key, source.strip()
