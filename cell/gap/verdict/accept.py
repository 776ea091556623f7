"""Acceptance of a verdict: the patch goes into the file, the old file can come back."""

import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cell.config.settings import CellSettings
from cell.gap.subject.mechanism.file import MechanismFile
from cell.gap.verdict.stored import Acceptance, FitRecord, Patch, read_stored
from drivers.errors import ConfigurationError
from drivers.files import MEGABYTE, lock_folders, read_bytes, read_text, write_file
from drivers.settings import load, parse, read_yaml
from drivers.strip.describe import load_strip
from drivers.strip.effects import check_effects
from drivers.yaml_edit import edit_text

RECORD, ACCEPTED = "fit.json", "accepted.json"
PATCH, CELL_PATCH, LAW_PATCH = "patch.yaml", "cell-patch.yaml", "law-patch.yaml"
BASE_PATCH = "base-patch.yaml"  # values alone: the runs show no effect, and others than stated
MODEL_PATCH, LAW_MODEL_PATCH = "model-patch.xml", "law-model-patch.xml"
ABSENT = ""  # text of a file that an acceptance makes


@dataclass(frozen=True, slots=True)
class Accepted:
    """What an acceptance changed: files written, effects added."""

    files: tuple[Path, ...]
    effects: tuple[str, ...]


def sha256(path: Path) -> str:
    """Hash of a file's bytes; a missing file is a ConfigurationError."""
    return hashlib.sha256(read_bytes(path, MEGABYTE)).hexdigest()


def accept(out: Path, file: Path, cell_file: Path | None = None, *, law: bool = False) -> Accepted:
    """Put the patches of the fit in `out` into `file` and, where one belongs there, the cell.

    With `law`, the law that describes what no effect explains. Refuses when `file` is not the one
    that was fitted, has changed since, or there is nothing to accept, and patches that are no
    longer whole: what is written can be read again. Files of an acceptance that died on the way are
    brought back first.
    """
    with lock_folders([out_folder(out), *_folders(file, cell_file)]):
        return _accept(out, file, cell_file, law=law)


def _accept(out: Path, file: Path, cell_file: Path | None, *, law: bool) -> Accepted:
    record = _record(out)
    _take_back_half(out, file, cell_file)
    patch, cell_patch = _patch(out, law=law), out / CELL_PATCH
    if not patch.exists():
        raise ConfigurationError(f"{out}: {_nothing(out, law=law)}")
    if sha256(file) != record.file_sha256:
        raise ConfigurationError(
            f"{file}: has changed since it was fitted (or is another file); fit again"
        )
    _check_patch(patch)
    changes = {file: edit_text(read_text(file), read_yaml(patch))}
    if cell_patch.exists() and not law:
        if cell_file is None:
            raise ConfigurationError(
                f"{cell_patch}: holds effects of the cell; name the cell file to put them in"
            )
        changes[cell_file] = _with_cell(cell_file, cell_patch)
    model = out / (LAW_MODEL_PATCH if law else MODEL_PATCH)
    if model.exists():
        named = str(read_yaml(patch)["model"])
        changes = {file.parent / named: read_text(model, 20 * MEGABYTE), **changes}
    _check_writable(list(changes))
    before = {_name(p): read_text(p) if p.exists() else ABSENT for p in changes}
    after = {_name(p): _hash(text) for p, text in changes.items()}
    kept = {"schema": 1, "before": before, "after": after}
    write_file(out / ACCEPTED, json.dumps(kept, indent=1))  # first: from it half a change is undone
    try:
        _write(changes)
    except ConfigurationError:
        with suppress(ConfigurationError):  # the next command tries again
            _take_back_half(out, file, cell_file)
        raise
    return Accepted(tuple(changes), record.laws if law else record.effects or record.values)


def _patch(out: Path, *, law: bool) -> Path:
    """The patch that is asked for: a law, what was named, or else the values of the base."""
    if law:
        return out / LAW_PATCH
    named, values = out / PATCH, out / BASE_PATCH
    return values if values.exists() and not named.exists() else named


def _nothing(out: Path, *, law: bool) -> str:
    """Why there is nothing to accept, and what there is instead."""
    if law:
        return "no law was offered, so there is none to accept"
    offered = "; a law is offered: add --law" if (out / LAW_PATCH).is_file() else ""
    return f"nothing was named, so there is nothing to accept{offered}"


def undo(out: Path, file: Path, cell_file: Path | None = None) -> Accepted:
    """Bring back the files as they were before the acceptance of the fit in `out`.

    Refuses when a file has changed since the acceptance. An undo that died on the way is finished.
    """
    with lock_folders([out_folder(out), *_folders(file, cell_file)]):
        return _undo(out, file, cell_file)


def _undo(out: Path, file: Path, cell_file: Path | None) -> Accepted:
    kept = out / ACCEPTED
    if not kept.exists():
        raise ConfigurationError(f"{out}: was not accepted, so there is nothing to undo")
    stored, record = read_stored(kept, Acceptance), _record(out)
    paths = _files_by_name(stored, kept, file, cell_file, _models_beside(out, file))
    for name, path in paths.items():
        if _current_hash(path) not in (stored.after.get(name), _hash(stored.before[name])):
            raise ConfigurationError(f"{path}: has changed since the acceptance; edit it by hand")
    _check_writable(list(paths.values()))
    _write({path: stored.before[name] for name, path in paths.items()})
    kept.unlink()
    return Accepted(tuple(paths.values()), record.effects or record.laws or record.values)


def _files_by_name(
    stored: Acceptance, kept: Path, file: Path, cell_file: Path | None, made: Sequence[Path]
) -> Mapping[str, Path]:
    """The files of an acceptance by their stored names; ConfigurationError for any but `file`,
    `cell_file` and the models `made` beside it.
    """
    given = {_name(p): p for p in (file, cell_file, *made) if p is not None}
    if _name(file) not in stored.before:
        raise ConfigurationError(f"{file}: is not the file that was accepted into")
    for name in stored.before:
        if name not in given:
            raise ConfigurationError(
                f"{kept}: names {name}, which is neither --strip nor the cell file; "
                "name the same --configs as for accept"
            )
    return {name: given[name] for name in stored.before}


def _take_back_half(out: Path, file: Path, cell_file: Path | None) -> None:
    """Bring back the files of an acceptance or undo that ended between two files.

    One that changed all of its files, or none, left nothing half, and files that somebody changed
    since are left alone.
    """
    kept = out / ACCEPTED
    if not kept.exists():
        return
    stored = read_stored(kept, Acceptance)
    if _name(file) not in stored.before:
        return
    paths = _files_by_name(stored, kept, file, cell_file, _models_beside(out, file))
    found = {name: _current_hash(path) for name, path in paths.items()}
    old = {name for name in paths if found[name] == _hash(stored.before[name])}
    new = {name for name in paths if found[name] == stored.after.get(name)} - old
    if not old or len(old) + len(new) < len(paths):
        return
    _write({paths[name]: stored.before[name] for name in new})
    kept.unlink()


def _write(changes: Mapping[Path, str]) -> None:
    """Write the files, one after the other; one that was absent goes."""
    for path, text in changes.items():
        if text == ABSENT:
            path.unlink(missing_ok=True)
        else:
            write_file(path, text)


def _current_hash(path: Path) -> str:
    """Hash of the file as it is, of ABSENT where there is none."""
    return sha256(path) if path.exists() else _hash(ABSENT)


def _folders(*files: Path | None) -> list[Path]:
    """Folders of those files that exist; a missing file is refused where it is read."""
    return [p.parent for p in files if p is not None and p.parent.is_dir()]


def out_folder(out: Path) -> Path:
    """The folder of a fit; ConfigurationError where there is none."""
    if not out.is_dir():
        what = "is a file" if out.exists() else "no such folder"
        raise ConfigurationError(f"{out}: {what}; name the folder that `cell gap fit --out` wrote")
    return out


def _models_beside(out: Path, file: Path) -> list[Path]:
    """Models that an acceptance of the fit in `out` writes beside `file`."""
    patches = [p for p in (out / PATCH, out / LAW_PATCH, out / BASE_PATCH) if p.exists()]
    kinds = [read_yaml(p) for p in patches]
    return [file.parent / str(k["model"]) for k in kinds if k.get("kind") == "mechanism"]


def _check_patch(patch: Path) -> None:
    """Refuse a patch that is not a whole file of a strip, a pendulum or a mechanism."""
    kind = read_yaml(patch).get("kind")
    if kind == "mechanism":
        load(patch, MechanismFile)
    elif kind == "pendulum":
        load(patch, Patch, bare=True)
    else:
        load_strip(patch)


def _with_cell(path: Path, patch: Path) -> str:
    """Text of the cell file with the effects and settings of `patch` merged in."""
    added = load(patch, Patch, bare=True)
    check_effects(added.effects, origin=str(patch), of="cell")
    content = read_yaml(path)
    _check_cell(content, path)
    merged = {**content, "effects": {**(content.get("effects") or {}), **added.effects}}
    for key, parts in (("fci", added.fci), ("twin", added.twin)):
        if parts:
            had: dict[str, Any] = content.get(key) or {}
            merged[key] = had | {k: (had.get(k) or {}) | part for k, part in parts.items()}
    _check_cell(merged, path)
    return edit_text(read_text(path), merged)


def _check_cell(content: Mapping[str, object], path: Path) -> None:
    """Refuse what is no cell file; its section `twin` is not checked."""
    known = {key: value for key, value in content.items() if key != "twin"}
    parse(known, CellSettings, str(path))


def _check_writable(paths: Sequence[Path]) -> None:
    """Refuse paths that cannot be written before the first file is changed."""
    for path in paths:
        for place in (path, path.parent):
            if place.exists() and not os.access(place, os.W_OK):
                raise ConfigurationError(
                    f"{place}: cannot be written: permission denied; mend its permissions"
                )


def _record(out: Path) -> FitRecord:
    path = out_folder(out) / RECORD
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
