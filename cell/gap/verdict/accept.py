"""Accepts a verdict: patches the subject's file, and can restore the one before."""

import hashlib
import os
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeVar

from pydantic import BaseModel, Field

from cell.base.config.settings import CellSettings
from cell.gap.fitting.reml import Spread
from cell.gap.subject.mechanism.mechanism_file import MechanismFile
from cell.gap.verdict.schema import fit_folder
from cell.record.header import Recorded
from drivers.base.errors import ConfigurationError
from drivers.base.files import lock_folders, write_file
from drivers.base.readers import MEGABYTE, read_bytes, read_json, read_text, read_yaml
from drivers.base.settings import load, parse
from drivers.base.yaml_text import edit_yaml
from drivers.strip.describe import load_strip
from drivers.strip.effects import check_effects

STORED = 4 * MEGABYTE
RECORD, ACCEPTED = "fit.json", "accepted.json"
PATCH, CELL_PATCH, LAW_PATCH = "patch.yaml", "cell-patch.yaml", "law-patch.yaml"
SUSPECT_PATCH = "suspect-patch.yaml"  # effects that were accepted and are not named
# values alone: no effect, but base values other than stated
BASE_PATCH = "base-patch.yaml"
MODEL_PATCH, LAW_MODEL_PATCH = "model-patch.xml", "law-model-patch.xml"
PATCHES = (PATCH, SUSPECT_PATCH, BASE_PATCH, LAW_PATCH)
ABSENT = ""  # text of a file that an acceptance makes
LARGEST_MODEL = 20 * MEGABYTE


class StoredLaw(Recorded):
    """Empirical law of residuals that a fit offered: amounts by the name of its
    terms.
    """

    terms: dict[str, float]


class FitRecord(Recorded):
    """Content of fit.json: the hash of the file that was fitted, and the effects of its
    patch.

    `values` of the base are outside what the file tolerates; `scatter` are quantities
    that differ from run to run; `law` describes what nothing explains.
    """

    file_sha256: str
    effects: tuple[str, ...]
    values: tuple[str, ...] = ()
    scatter: tuple[Spread, ...] = ()
    law: StoredLaw | None = None

    @property
    def laws(self) -> tuple[str, ...]:
        """Names of the terms of the empirical law that the fit offers."""
        return tuple(self.law.terms) if self.law is not None else ()


class Acceptance(Recorded):
    """Content of accepted.json: by path, the text before an acceptance and the hash
    after it.
    """

    before: dict[str, str]
    after: dict[str, str]

    def state(self, name: str, path: Path) -> Literal["before", "after", "changed"]:
        """Whether the file at `path` has its text from before or after the acceptance,
        or other.
        """
        current = sha256(path) if path.exists() else _hash(ABSENT)
        if current == self.after.get(name):
            return "after"
        return "before" if current == _hash(self.before[name]) else "changed"


class Patch(Recorded):
    """Content of a patch: parameters by effect, and settings of the cell.

    Settings are those of an arm: its tool, and the delay of its twin.
    """

    effects: dict[str, dict[str, float]]
    fci: dict[str, dict[str, Any]] = Field(default_factory=dict)
    twin: dict[str, dict[str, Any]] = Field(default_factory=dict)


S = TypeVar("S", bound=BaseModel)


def read_stored(path: Path, model: type[S]) -> S:
    """Content of the JSON file at `path` as `model`; ConfigurationError where it is
    broken.
    """
    return parse(read_json(path, STORED), model, str(path))


@dataclass(frozen=True, slots=True)
class AcceptResult:
    """Files that an acceptance or undo has written, and the effects or values
    concerned.
    """

    files: tuple[Path, ...]
    effects: tuple[str, ...]


def sha256(path: Path) -> str:
    """Hash of the file at `path`; ConfigurationError where it is missing."""
    return hashlib.sha256(read_bytes(path, MEGABYTE)).hexdigest()


def accept(
    out: Path,
    file: Path,
    cell_file: Path | None = None,
    *,
    law: bool = False,
    force: bool = False,
) -> AcceptResult:
    """Apply the patch of the fit in `out` to the subject's `file` and, if needed, to
    the cell file.

    With `law`, the patch of the law that describes what no effect explains; with
    `force`, that of effects that are suspected, where none is named. Files of an
    interrupted acceptance are restored first. Raises ConfigurationError where `file` is
    not the fitted one or has changed since, where there is nothing to accept, or where
    a patch is incomplete.
    """
    with lock_folders([fit_folder(out), *_folders(file, cell_file)]):
        record = _read_fit_record(out)
        _restore_interrupted(out, file, cell_file)
        patch = _patch(out, law=law, force=force)
        if not patch.exists():
            raise ConfigurationError(f"{out}: {_nothing_to_accept(out, law=law)}")
        if sha256(file) != record.file_sha256:
            raise ConfigurationError(
                f"{file}: has changed since it was fitted (or is another file); fit"
                " again"
            )
        _check_patch(patch)
        changes = _changes(out, patch, file, cell_file, law=law)
        _store_undo(out, changes)
        try:
            _write(changes)
        except ConfigurationError:
            with suppress(ConfigurationError):  # the next command tries again
                _restore_interrupted(out, file, cell_file)
            raise
    return AcceptResult(
        tuple(changes), record.laws if law else record.effects or record.values
    )


def _store_undo(out: Path, changes: Mapping[Path, str]) -> None:
    """Store in `out`, before any file changes, the texts that `changes` will
    replace.
    """
    _check_writable(changes)
    before = {_name(p): read_text(p) if p.exists() else ABSENT for p in changes}
    after = {_name(p): _hash(text) for p, text in changes.items()}
    stored = Acceptance(before=before, after=after)
    write_file(out / ACCEPTED, stored.model_dump_json(by_alias=True, indent=1))


def _changes(
    out: Path, patch: Path, file: Path, cell_file: Path | None, *, law: bool
) -> dict[Path, str]:
    """New text of each file by path: of a model, of the subject's `file`, of the cell
    file.
    """
    changes = {file: edit_yaml(read_text(file), read_yaml(patch))}
    cell_patch = out / CELL_PATCH
    if cell_patch.exists() and not law:
        if cell_file is None:
            raise ConfigurationError(
                f"{cell_patch}: holds effects of the cell; name the cell file to put"
                " them in"
            )
        changes[cell_file] = _with_cell(cell_file, cell_patch)
    model = out / (LAW_MODEL_PATCH if law else MODEL_PATCH)
    if model.exists():
        named = str(read_yaml(patch)["model"])
        changes = {file.parent / named: read_text(model, LARGEST_MODEL), **changes}
    return changes


def _patch(out: Path, *, law: bool, force: bool) -> Path:
    """Path of the patch to accept: a law, named or suspected effects, or else base
    values.
    """
    if law:
        return out / LAW_PATCH
    if force and (out / SUSPECT_PATCH).exists():
        return out / SUSPECT_PATCH
    named, values = out / PATCH, out / BASE_PATCH
    return values if values.exists() and not named.exists() else named


def _nothing_to_accept(out: Path, *, law: bool) -> str:
    """Message that there is nothing to accept, with a hint at an option that helps."""
    if law:
        return "no law was offered, so there is none to accept"
    offered = "; a law is offered: add --law" if (out / LAW_PATCH).is_file() else ""
    if (out / SUSPECT_PATCH).is_file():
        offered += "; effects are suspected (report.html): --force accepts them"
    return f"nothing was named, so there is nothing to accept{offered}"


def undo(out: Path, file: Path, cell_file: Path | None = None) -> AcceptResult:
    """Restore the files as they were before the fit in `out` was accepted.

    Raises ConfigurationError when a file has changed since. An interrupted undo is
    finished.
    """
    accepted = fit_folder(out) / ACCEPTED
    with lock_folders([out, *_folders(file, cell_file)]):
        if not accepted.exists():
            raise ConfigurationError(
                f"{out}: was not accepted, so there is nothing to undo"
            )
        stored = read_stored(accepted, Acceptance)
        record = _read_fit_record(out)
        paths = _files_by_name(stored, accepted, file, cell_file)
        for name, path in paths.items():
            if stored.state(name, path) == "changed":
                raise ConfigurationError(
                    f"{path}: has changed since the acceptance; edit it by hand"
                )
        _check_writable(paths.values())
        _restore(accepted, stored, paths)
    return AcceptResult(
        tuple(paths.values()), record.effects or record.laws or record.values
    )


def _restore_interrupted(out: Path, file: Path, cell_file: Path | None) -> None:
    """Restore the files of an acceptance or undo that was interrupted between two
    files.

    One that changed all of its files was complete, and files that somebody changed
    since are left alone.
    """
    accepted = out / ACCEPTED
    stored = read_stored(accepted, Acceptance) if accepted.exists() else None
    if stored is None or _name(file) not in stored.before:
        return
    paths = _files_by_name(stored, accepted, file, cell_file)
    states = {stored.state(name, path) for name, path in paths.items()}
    if "before" in states and "changed" not in states:
        _restore(accepted, stored, paths)


def _restore(accepted: Path, stored: Acceptance, paths: Mapping[str, Path]) -> None:
    """Restore the files that the acceptance `stored` replaced, and delete its record
    `accepted`.
    """
    _write({path: stored.before[name] for name, path in paths.items()})
    accepted.unlink()


def _files_by_name(
    stored: Acceptance, accepted: Path, file: Path, cell_file: Path | None
) -> dict[str, Path]:
    """Paths of the files of an acceptance, by their stored names.

    Raises ConfigurationError for any but `file`, `cell_file` and the models beside it
    that the patches in the folder of `accepted` name.
    """
    paths = [accepted.parent / name for name in PATCHES]
    patches = [read_yaml(path) for path in paths if path.exists()]
    models = [
        file.parent / str(p["model"]) for p in patches if p.get("kind") == "mechanism"
    ]
    given = {_name(p): p for p in (file, cell_file, *models) if p is not None}
    if _name(file) not in stored.before:
        raise ConfigurationError(f"{file}: is not the file that was accepted into")
    for name in stored.before:
        if name not in given:
            raise ConfigurationError(
                f"{accepted}: names {name}, which is neither --strip nor the cell file;"
                " name the same --configs as for accept"
            )
    return {name: given[name] for name in stored.before}


def _write(changes: Mapping[Path, str]) -> None:
    """Write the files of an acceptance one by one; delete those whose text is
    ABSENT.
    """
    for path, text in changes.items():
        if text == ABSENT:
            path.unlink(missing_ok=True)
        else:
            write_file(path, text)


def _folders(*files: Path | None) -> list[Path]:
    """Existing folders of the given files; a missing file is refused only on
    reading.
    """
    return [p.parent for p in files if p is not None and p.parent.is_dir()]


def _check_patch(patch: Path) -> None:
    """Refuse a patch that is not a whole file of a strip or a mechanism."""
    if read_yaml(patch).get("kind") == "mechanism":
        load(patch, MechanismFile)
    else:
        load_strip(patch)


def _with_cell(path: Path, patch: Path) -> str:
    """Text of the cell file with the effects and settings of `patch` merged in."""
    added = load(patch, Patch, bare=True)
    check_effects(added.effects, origin=str(patch), of=["cell"])
    content = read_yaml(path)
    _check_cell(content, path)
    merged = {**content, "effects": {**(content.get("effects") or {}), **added.effects}}
    for key, parts in (("fci", added.fci), ("twin", added.twin)):
        if parts:
            old: dict[str, Any] = content.get(key) or {}
            merged[key] = old | {
                k: (old.get(k) or {}) | part for k, part in parts.items()
            }
    _check_cell(merged, path)
    return edit_yaml(read_text(path), merged)


def _check_cell(content: Mapping[str, object], path: Path) -> None:
    """Refuse `content` that is no valid cell file; its section `twin` is not
    checked.
    """
    known = {key: value for key, value in content.items() if key != "twin"}
    parse(known, CellSettings, str(path))


def _check_writable(paths: Iterable[Path]) -> None:
    """Refuse paths that cannot be written before the first file is changed."""
    for path in paths:
        for place in (path, path.parent):
            if place.exists() and not os.access(place, os.W_OK):
                raise ConfigurationError(
                    f"{place}: cannot be written: permission denied; mend its"
                    " permissions"
                )


def _read_fit_record(out: Path) -> FitRecord:
    """Record of the fit in `out`; ConfigurationError where it is missing or broken."""
    path = fit_folder(out) / RECORD
    try:
        return read_stored(path, FitRecord)
    except ConfigurationError:
        raise ConfigurationError(
            f"{path}: is missing or not as `cell gap fit` writes it; fit again"
        ) from None


def _name(path: Path) -> str:
    """Resolved path as text that UTF-8 can encode, other characters escaped."""
    return str(path.resolve()).encode(errors="backslashreplace").decode()


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode("utf-8", errors="backslashreplace")).hexdigest()
