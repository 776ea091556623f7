"""Acceptance of a verdict: the patch goes into the file, the old file can come back."""

import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import yaml

from cell.config.settings import CellSettings
from cell.gap.verdict.schema import write_text
from cell.gap.verdict.stored import Acceptance, FitRecord, Patch, read_stored
from drivers.errors import ConfigurationError
from drivers.files import MEGABYTE, read_bytes, read_text
from drivers.settings import load, parse, read_yaml
from drivers.strip.describe import load_strip
from drivers.strip.effects import check_effects

RECORD, ACCEPTED = "fit.json", "accepted.json"
PATCH, CELL_PATCH, LAW_PATCH = "patch.yaml", "cell-patch.yaml", "law-patch.yaml"


@dataclass(frozen=True, slots=True)
class Accepted:
    """What an acceptance changed: files written, effects added."""

    files: tuple[Path, ...]
    effects: tuple[str, ...]


def sha256(path: Path) -> str:
    """Hash of a file's bytes; a missing file is a ConfigurationError."""
    return hashlib.sha256(read_bytes(path, MEGABYTE)).hexdigest()


def dumped(content: Mapping[str, object]) -> str:
    """YAML text of a file's content, keys in the order given."""
    return yaml.safe_dump(dict(content), sort_keys=False, allow_unicode=True, width=100)


def accept(out: Path, file: Path, cell_file: Path | None = None, *, law: bool = False) -> Accepted:
    """Put the patches of the fit in `out` into `file` and, where one belongs there, the cell.

    With `law`, the law that describes what no effect explains. Refuses when `file` is not the one
    that was fitted, has changed since, or there is nothing to accept, and patches that are no
    longer whole: what is written can be read again.
    """
    record = _record(out)
    patch, cell_patch = out / (LAW_PATCH if law else PATCH), out / CELL_PATCH
    if not patch.exists():
        raise ConfigurationError(f"{out}: {_nothing(out, law=law)}")
    if sha256(file) != record.file_sha256:
        raise ConfigurationError(
            f"{file}: has changed since it was fitted (or is another file); fit again"
        )
    changes = {file: _checked_patch(patch)}
    if cell_patch.exists() and not law:
        if cell_file is None:
            raise ConfigurationError(
                f"{cell_patch}: holds effects of the cell; name the cell file to put them in"
            )
        changes[cell_file] = _with_cell(cell_file, cell_patch)
    _check_writable(list(changes))
    before = {_name(p): read_text(p) for p in changes}
    after = {_name(p): _hash(text) for p, text in changes.items()}
    kept = {"schema": 1, "before": before, "after": after}
    write_text(out / ACCEPTED, json.dumps(kept, indent=1))
    for path, text in changes.items():
        write_text(path, text)
    return Accepted(tuple(changes), record.laws if law else record.effects)


def _nothing(out: Path, *, law: bool) -> str:
    """Why there is nothing to accept, and what there is instead."""
    if law:
        return "no law was offered, so there is none to accept"
    offered = "; a law is offered: add --law" if (out / LAW_PATCH).is_file() else ""
    return f"nothing was named, so there is nothing to accept{offered}"


def undo(out: Path, file: Path, cell_file: Path | None = None) -> Accepted:
    """Bring back the files as they were before the acceptance of the fit in `out`.

    Refuses when a file has changed since the acceptance.
    """
    kept = out / ACCEPTED
    if not kept.exists():
        raise ConfigurationError(f"{out}: was not accepted, so there is nothing to undo")
    stored, record = read_stored(kept, Acceptance), _record(out)
    given = {_name(p): p for p in (file, cell_file) if p is not None}
    if _name(file) not in stored.before:
        raise ConfigurationError(f"{file}: is not the file that was accepted into")
    paths = {name: given.get(name, Path(name)) for name in stored.before}
    for name, path in paths.items():
        if name not in given:
            raise ConfigurationError(
                f"{kept}: names {name}, which is neither --strip nor the cell file; "
                "name the same --configs as for accept"
            )
        if sha256(path) != stored.after.get(name):
            raise ConfigurationError(f"{path}: has changed since the acceptance; edit it by hand")
    _check_writable(list(paths.values()))
    for name, path in paths.items():
        write_text(path, stored.before[name])
    kept.unlink()
    return Accepted(tuple(paths.values()), record.effects or record.laws)


def _checked_patch(patch: Path) -> str:
    """Text of the patch, which is a whole file of a strip or a pendulum."""
    if read_yaml(patch).get("kind") == "pendulum":
        load(patch, Patch, bare=True)
    else:
        load_strip(patch)
    return read_text(patch)


def _with_cell(path: Path, patch: Path) -> str:
    """Text of the cell file with the effects of `patch` merged in."""
    added = load(patch, Patch, bare=True).effects
    check_effects(added, origin=str(patch), of="cell")
    content = read_yaml(path)
    _check_cell(content, path)
    merged = {**content, "effects": {**(content.get("effects") or {}), **added}}
    _check_cell(merged, path)
    return dumped(merged)


def _check_cell(content: Mapping[str, object], path: Path) -> None:
    """Refuse what is no cell file; what it says of the twin is nobody's business here."""
    known = {key: value for key, value in content.items() if key != "twin"}
    parse(known, CellSettings, str(path))


def _check_writable(paths: Sequence[Path]) -> None:
    """Refuse before the first of them is written, not between two."""
    for path in paths:
        for place in (path, path.parent):
            if not os.access(place, os.W_OK):
                raise ConfigurationError(
                    f"{place}: cannot be written: permission denied; mend its permissions"
                )


def _record(out: Path) -> FitRecord:
    if not out.is_dir():
        raise ConfigurationError(
            f"{out}: no such folder; name the one that `cell gap fit --out` wrote"
        )
    path = out / RECORD
    try:
        return read_stored(path, FitRecord)
    except ConfigurationError as error:
        if "is missing; add it" in str(error):
            raise ConfigurationError(f"{path}: lacks file_sha256 or effects; fit again") from None
        raise ConfigurationError(f"{path}: is missing or broken; fit again") from None


def _name(path: Path) -> str:
    """The whole path as text that any file can hold."""
    return str(path.resolve()).encode(errors="backslashreplace").decode()


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode("utf-8", errors="backslashreplace")).hexdigest()
