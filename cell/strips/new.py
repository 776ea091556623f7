"""A new strip: what its maker stated, and `assumed` for all that nobody measured."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from cell.strips.edit import create
from drivers.errors import ConfigurationError

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
    """A strip file at `path`; `stated` values may be None, `sources` read `key=where from`."""
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
