"""Editing of strip files, which keeps a person's formatting where nothing changes."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from drivers.errors import ConfigurationError
from drivers.files import change_file
from drivers.settings import parse
from drivers.strip.file import StripFile
from drivers.yaml_text import dump_yaml


def with_measured(
    content: Mapping[str, Any], key: str, value: float, source: str, note: str
) -> dict[str, Any]:
    """Content of a strip file with `key` measured; the old value stays in its provenance."""
    kept = [dict(each) for each in content.get("provenance") or ()]
    for entry in kept:
        if entry.get("key") == key:
            entry["note"] = f"until then {content[key]:g}; {entry.get('note', '')}".strip("; ")
    measured = {"key": key, "source": source, "note": note}
    return {**content, key: value, "provenance": [measured, *kept]}


def create(path: Path, content: Mapping[str, Any]) -> None:
    """Check `content` and write it to a new strip file at `path`; an existing one is refused."""
    parse(content, StripFile, str(path))

    def make(_: str) -> str:
        if path.exists():
            raise ConfigurationError(
                f"{path}: is there already; choose another name or edit the file"
            )
        return dump_yaml(content)

    change_file(path, make)


SOURCED = ("areal_density", "bending_length", "retardation_time", "thickness")
ASSUMED_VALUES = {
    "areal_density": 0.2,  # kg/m^2, a shirting
    "bending_length": 0.020,  # m, the middle of what fabrics have
    "retardation_time": 0.05,  # s; nobody publishes it
    "thickness": 0.001,  # m
}


def new_strip(
    path: Path, stated: Mapping[str, Any], colour: Sequence[int] | None, sources: Sequence[str]
) -> None:
    """Write a new strip file at `path` with the `stated` values, None where they are assumed.

    `sources` read `key=where from`. Raises ConfigurationError for a source without its value.
    """
    noted = dict(_source(each) for each in sources)
    for key in noted:
        if stated.get(key) is None:
            raise ConfigurationError(f"--source: {key}: give its value too")
    content: dict[str, Any] = {"schema": 1, "name": path.stem}
    content |= {
        key: ASSUMED_VALUES[key] if value is None else value for key, value in stated.items()
    }
    if colour is not None:
        content["colour"] = list(colour)
    content["provenance"] = [
        {"key": key, "source": noted.get(key, "assumed" if stated[key] is None else "measured")}
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
