"""Writing of strip files: new ones, and a measured bending length put into an existing
one.
"""

import json
from collections.abc import Mapping, Sequence
from datetime import date
from functools import partial
from pathlib import Path
from typing import Any

from cell.record.documents import plain
from cell.setup.strips.fit_figure import fit_figure
from cell.setup.strips.measurement import Measurement
from drivers.base.errors import ConfigurationError
from drivers.base.files import change_file, replace_file, writing
from drivers.base.settings import parse
from drivers.base.yaml_text import dump_yaml, edit_yaml, parse_yaml
from drivers.strip.file import StripFile

MEASUREMENT_FILE = "measurement.json"
SOURCED = ("areal_density", "bending_length", "retardation_time", "thickness")
ASSUMED_VALUES = {
    "areal_density": 0.2,  # kg/m^2, a shirting
    "bending_length": 0.020,  # m, typical of fabrics
    "retardation_time": 0.05,  # s; no source publishes it
    "thickness": 0.001,  # m
}


def new_strip(
    path: Path,
    stated: Mapping[str, Any],
    colour: Sequence[int] | None,
    sources: Sequence[str],
) -> None:
    """Write a new strip file at `path` with the values in `stated`, by key; where a
    value is None, a usual one is assumed.

    `sources` read `key=where from`. Raises ConfigurationError for a source without its
    value.
    """
    source_of = dict(_source(each) for each in sources)
    for key in source_of:
        if stated.get(key) is None:
            raise ConfigurationError(f"--source: {key}: give its value too")

    content: dict[str, Any] = {"schema": 1, "name": path.stem}
    content |= {
        key: ASSUMED_VALUES[key] if value is None else value
        for key, value in stated.items()
    }
    if colour is not None:
        content["colour"] = list(colour)

    content["provenance"] = [
        {
            "key": key,
            "source": source_of.get(
                key, "assumed" if stated[key] is None else "measured"
            ),
        }
        for key in SOURCED
    ]
    parse(content, StripFile, str(path))
    change_file(path, partial(_text_of_new, path, content))


def _text_of_new(path: Path, content: Mapping[str, Any], _: str) -> str:
    """Text of a new strip file with the given `content`; ConfigurationError where a
    file at `path` exists already.
    """
    if path.exists():
        raise ConfigurationError(
            f"{path}: is there already; choose another name or edit the file"
        )
    return dump_yaml(content)


def _source(text: str) -> tuple[str, str]:
    """Key of a strip file and the source of its value, from a text `KEY=TEXT`;
    ConfigurationError for any other text.
    """
    key, equals, source = text.partition("=")
    if not equals or key not in SOURCED or not source.strip():
        raise ConfigurationError(
            f"--source: {text!r} is not KEY=TEXT; KEY is one of {', '.join(SOURCED)}"
        )
    return key, source.strip()


def save(measurement: Measurement, folder: Path) -> None:
    """Write a figure of each photograph, and all numbers of `measurement` as JSON, into
    `folder`; ConfigurationError where that fails.
    """
    pairs = zip(measurement.bending.fits, measurement.bending.straight, strict=True)
    pictures = {
        f"{index:02d}-{fit.photograph.name}.png": fit_figure(fit, straight)
        for index, (fit, straight) in enumerate(pairs, start=1)
    }
    numbers = json.dumps(plain(measurement.line()), indent=1, ensure_ascii=False) + "\n"
    with writing(f"--out: {folder}"):
        folder.mkdir(parents=True, exist_ok=True)
        replace_file(folder / MEASUREMENT_FILE, numbers.encode())
        for name, content in pictures.items():
            replace_file(folder / name, content)


def put_into(path: Path, measurement: Measurement, today: date) -> None:
    """Write the measured bending length, with a note on how it was measured, into the
    strip file at `path`.
    """
    fits = measurement.bending.fits
    pooled = measurement.bending_length
    overhangs = sorted({each.photograph.overhang for each in fits})
    count = len(fits)
    source = (
        f"cantilever test, {count} photograph{'s' * (count > 1)} at overhangs of"
        f" {', '.join(f'{each:g}' for each in overhangs)} m, measured"
        f" {today.isoformat()}"
    )
    note = (
        f"95 % between {pooled.low:.4g} and {pooled.high:.4g} m; "
        f"born {measurement.bending.prior.kind.value}; some yarn friction is in it"
    )
    entry = {"key": "bending_length", "source": source, "note": note}
    change_file(path, partial(_with_measured, path, measurement.value, entry))


def _with_measured(
    path: Path, value: float, entry: Mapping[str, str], text: str
) -> str:
    """Copy of the `text` of a strip file in which the key of `entry` has the measured
    `value`, and in which `entry` notes how it was measured.

    The old value goes into the note of its own entry.
    """
    content = parse_yaml(text, str(path))
    key = entry["key"]
    entries = [dict(old) for old in content.get("provenance") or ()]
    for old in entries:
        if old.get("key") == key:
            old["note"] = f"until then {content[key]:g}; {old.get('note', '')}".strip(
                "; "
            )

    content = {**content, key: value, "provenance": [dict(entry), *entries]}
    parse(content, StripFile, str(path))
    return edit_yaml(text, content)
