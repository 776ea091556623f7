"""Acceptance of a verdict: the patch goes into the file, the old file can come back."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from cell.gap.verdict.schema import write_text
from drivers.errors import ConfigurationError
from drivers.settings import read_yaml

RECORD = "fit.json"
PATCH, CELL_PATCH = "patch.yaml", "cell-patch.yaml"


@dataclass(frozen=True, slots=True)
class Accepted:
    """What an acceptance changed: files written, effects added."""

    files: tuple[Path, ...]
    effects: tuple[str, ...]


def sha256(path: Path) -> str:
    """Hash of a file's bytes; a missing file is a ConfigurationError."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise ConfigurationError(f"{path}: cannot be read: {error.strerror}") from None


def dumped(content: Mapping[str, object]) -> str:
    """YAML text of a file's content, keys in the order given."""
    return yaml.safe_dump(dict(content), sort_keys=False, allow_unicode=True, width=100)


def accept(out: Path, file: Path, cell_file: Path | None = None) -> Accepted:
    """Put the patches of the fit in `out` into `file` and, where one belongs there, the cell.

    Refuses when `file` is not the one that was fitted, has changed since, or nothing was named.
    """
    record = _record(out)
    patch, cell_patch = out / PATCH, out / CELL_PATCH
    if not patch.is_file():
        raise ConfigurationError(f"{out}: nothing was named, so there is nothing to accept")
    if sha256(file) != record["file_sha256"]:
        raise ConfigurationError(
            f"{file}: has changed since it was fitted (or is another file); fit again"
        )
    changes = {file: patch.read_text(encoding="utf-8")}
    if cell_patch.is_file():
        if cell_file is None:
            raise ConfigurationError(
                f"{cell_patch}: holds effects of the cell; name the cell file to put them in"
            )
        changes[cell_file] = _with_cell(cell_file, read_yaml(cell_patch))
    before = {str(p.resolve()): p.read_text(encoding="utf-8") for p in changes}
    after = {str(p.resolve()): _hash(text) for p, text in changes.items()}
    write_text(out / "accepted.json", json.dumps({"before": before, "after": after}, indent=1))
    for path, text in changes.items():
        write_text(path, text)
    return Accepted(tuple(changes), tuple(record["effects"]))


def undo(out: Path, file: Path, cell_file: Path | None = None) -> Accepted:
    """Bring back the files as they were before the acceptance of the fit in `out`.

    Refuses when a file has changed since the acceptance.
    """
    kept = out / "accepted.json"
    if not kept.is_file():
        raise ConfigurationError(f"{out}: was not accepted, so there is nothing to undo")
    stored = json.loads(kept.read_text(encoding="utf-8"))
    given = {str(p.resolve()): p for p in (file, cell_file) if p is not None}
    if str(file.resolve()) not in stored["before"]:
        raise ConfigurationError(f"{file}: is not the file that was accepted into")
    paths = {name: given.get(name, Path(name)) for name in stored["before"]}
    for name, path in paths.items():
        if sha256(path) != stored["after"][name]:
            raise ConfigurationError(f"{path}: has changed since the acceptance; edit it by hand")
    for name, path in paths.items():
        write_text(path, stored["before"][name])
    kept.unlink()
    return Accepted(tuple(paths.values()), tuple(_record(out)["effects"]))


def _with_cell(path: Path, patch: Mapping[str, Any]) -> str:
    """Text of the cell file with the patch's effects merged in."""
    content = read_yaml(path)
    effects = {**(content.get("effects") or {}), **patch["effects"]}
    return dumped({**content, "effects": effects})


def _record(out: Path) -> dict[str, Any]:
    path = out / RECORD
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        raise ConfigurationError(f"{path}: is missing or broken; fit again") from None
    if not isinstance(record, dict) or not {"file_sha256", "effects"} <= set(record):
        raise ConfigurationError(f"{path}: lacks file_sha256 or effects; fit again")
    return record


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode("utf-8")).hexdigest()
