"""Accepts a verdict: patches the subject's file, and can restore the one before.

What restores it lies beside the file, in a record that nothing else writes. It is
written before any file changes, so that an acceptance which was killed is taken back by
the next command. Each file is looked at again right before it is replaced.
"""

import hashlib
import os
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Literal, NamedTuple

from pydantic import Field

from cell.base.config.settings import CellSettings
from cell.gap.subject.mechanism.mechanism_file import ACCEPTED_MODEL, MechanismFile
from cell.gap.verdict.fit_folder import VERDICT, FitRecord, PatchFiles, read_record
from cell.gap.verdict.schema import StepKind, fit_folder, read_verdict
from cell.record.header import Recorded
from drivers.base.errors import ConfigurationError
from drivers.base.files import (
    encoded,
    lock_folders,
    replace_file,
    write_file,
    writing,
)
from drivers.base.readers import (
    MEGABYTE,
    file_digest,
    read_json,
    read_text,
    read_yaml,
)
from drivers.base.settings import load, parse
from drivers.base.yaml_text import edit_yaml, parse_yaml
from drivers.strip.describe import load_strip
from drivers.strip.effects import check_effects

State = Literal["before", "after", "changed"]
ABSENT = ""  # text of a file that an acceptance makes
UNDO = ".undo.json"  # after the name of the file that was accepted into
LARGEST_MODEL, LARGEST_UNDO = 20 * MEGABYTE, 64 * MEGABYTE


class Acceptance(Recorded):
    """One acceptance of a fit's patch: the name of the fit's folder, the accepted
    effects, and for each changed file, named by its path relative to the folder of the
    accepted file, its text before and the digest of its text after.
    """

    fit: str
    effects: tuple[str, ...]
    before: dict[str, str]
    after: dict[str, str]

    def state(self, name: str, text: str) -> State:
        """Whether `text`, read from the file stored as `name`, is the file's text from
        before the acceptance ("before"), from after it ("after"), or neither
        ("changed").
        """
        if _digest(text) == self.after.get(name):
            return "after"
        return "before" if text == self.before[name] else "changed"


class UndoRecord(Recorded):
    """Content of the record kept beside an accepted file: every acceptance into that
    file that can still be undone, oldest first.
    """

    acceptances: tuple[Acceptance, ...]


class Patch(Recorded):
    """Content of a patch: parameters by effect, and settings of the cell.

    Settings are those of an arm: its tool, and the delay of its twin.
    """

    effects: dict[str, dict[str, float]]
    fci: dict[str, dict[str, Any]] = Field(default_factory=dict)
    twin: dict[str, dict[str, Any]] = Field(default_factory=dict)


class AcceptResult(NamedTuple):
    """Paths of the files that an acceptance or its undo has written, and the names of
    the effects or values that were accepted or taken back.
    """

    files: tuple[Path, ...]
    effects: tuple[str, ...]


class Change(NamedTuple):
    """Change of the text of the file at `path` from `old` to `new`, where the constant
    ABSENT in place of a text means that no file exists.
    """

    path: Path
    old: str
    new: str

    @property
    def is_made(self) -> bool:
        """Whether the file at `path` now has the text `new`."""
        return _text_at(self.path) == self.new

    def check(self) -> None:
        """Raise ConfigurationError unless the file at `path` still has the
        text `old`.
        """
        if _text_at(self.path) != self.old:
            raise ConfigurationError(
                f"{self.path}: was changed a moment ago and is left alone; do it again"
            )


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
    interrupted acceptance are restored first. Raises ConfigurationError where `file`,
    its model or the cell file is not the fitted one or has changed since, where there
    is nothing to accept, or where the fit is not complete.
    """
    with lock_folders([fit_folder(out), *_folders(file, cell_file)]):
        record = read_record(out)
        _restore_interrupted(file, cell_file)
        files = offered(out, record, law=law, force=force)
        _check_unchanged(record, file, cell_file if files.cell else None)
        changes = _changes(out, files, file, cell_file)
        effects = record.laws if law else record.effects or record.values
        _store_undo(out, file, effects, changes)

        try:
            _write_all(changes)
        except ConfigurationError:
            if not any(change.is_made for change in changes):
                with suppress(ConfigurationError):  # else the next command does it
                    _store(file, _acceptances(file)[:-1])
            raise
    return _result(changes, effects)


def undo(out: Path, file: Path, cell_file: Path | None = None) -> AcceptResult:
    """Restore the files as they were before the fit in `out` was accepted.

    The folder itself is not needed. Raises ConfigurationError where another fit was
    accepted later, or a file has changed since. An interrupted undo is finished.
    """
    with lock_folders(_folders(file, cell_file)):
        stored = _acceptances(file)
        if not stored:
            raise ConfigurationError(
                f"{file}: nothing was accepted into it, so there is nothing to undo"
            )

        last = stored[-1]
        if last.fit != _name(out):
            raise ConfigurationError(
                f"{out}: is not the fit that was accepted last, which is {last.fit};"
                " undo that one first"
            )

        back, states = _way_back(last, file, cell_file)
        if "changed" in states:
            path = back[states.index("changed")].path
            raise ConfigurationError(
                f"{path}: has changed since the acceptance; edit it by hand"
            )

        _check_writable(back)
        _write_all(back)
        _store(file, stored[:-1])
    return _result(back, last.effects)


def _result(changes: Sequence[Change], effects: tuple[str, ...]) -> AcceptResult:
    return AcceptResult(tuple(change.path for change in changes), effects)


def offered(
    out: Path, record: FitRecord, *, law: bool = False, force: bool = False
) -> PatchFiles:
    """Files to accept: of a law, of named effects, of values or, by `force`, of
    suspects. Raises ConfigurationError where there are none.
    """
    wanted: list[StepKind] = ["accept_law"] if law else ["accept", "accept_values"]
    if force and not law:
        wanted.append("accept_suspected")

    found = [record.patches[kind] for kind in wanted if kind in record.patches]
    if found:
        return found[0]

    what = "no law was offered" if law else "nothing was named"
    steps = "; or: ".join(step.sentence for step in read_verdict(out / VERDICT).steps)
    raise ConfigurationError(
        f"{out}: {what}, so there is nothing to accept; next: {steps}"
    )


def _check_unchanged(record: FitRecord, file: Path, cell_file: Path | None) -> None:
    """Raise ConfigurationError where `file`, a part of its model or the cell file
    differs from what was fitted; a `cell_file` of None is not checked.
    """
    folder = file.resolve().parent
    fitted = {file: record.file_sha256}
    fitted |= {folder / part: digest for part, digest in record.parts.items()}
    if cell_file and record.cell_sha256:
        fitted[cell_file] = record.cell_sha256
    for path, digest in fitted.items():
        if file_digest(path) != digest:
            raise ConfigurationError(
                f"{path}: has changed since it was fitted (or is another file); fit"
                " again"
            )


def _changes(
    out: Path, offered: PatchFiles, file: Path, cell_file: Path | None
) -> list[Change]:
    """Changes that an acceptance makes: to the model if it has one to write, to the
    subject's `file`, and to the cell file if needed, in this order.
    """
    patch = out / offered.subject
    _check_patch(patch)
    content = read_yaml(patch)
    text = read_text(file)
    changes = [Change(file, text, edit_yaml(text, content))]

    if offered.model:
        model = file.parent / str(content["model"])
        _check_own_model(file, model)
        made = read_text(out / offered.model, LARGEST_MODEL)
        changes.insert(0, Change(model, _text_at(model), made))

    if offered.cell:
        of_cell = out / offered.cell
        if not cell_file:
            raise ConfigurationError(
                f"{of_cell}: holds effects of the cell; name the cell file to put them"
                " in"
            )
        text = read_text(cell_file)
        changes.append(Change(cell_file, text, _with_cell(text, cell_file, of_cell)))
    return changes


def _check_own_model(file: Path, model: Path) -> None:
    """Refuse to write over a `model` that is neither that of `file` nor an accepted
    one.
    """
    if not model.exists() or model == file.parent / str(read_yaml(file)["model"]):
        return
    name = _relative(model, file)
    if file_digest(model) not in {a.after.get(name) for a in _acceptances(file)}:
        raise ConfigurationError(
            f"{model}: is there already and no acceptance wrote it; move it away"
        )


def _store_undo(
    out: Path, file: Path, effects: tuple[str, ...], changes: Iterable[Change]
) -> None:
    """Store beside `file`, before any file changes, the earlier text of each file in
    `changes`, so that the acceptance can be undone.
    """
    changed = {_relative(change.path, file): change for change in changes}
    _check_writable(changed.values())
    made = Acceptance(
        fit=_name(out),
        effects=effects,
        before={name: change.old for name, change in changed.items()},
        after={name: _digest(change.new) for name, change in changed.items()},
    )
    _store(file, (*_acceptances(file), made))


def _restore_interrupted(file: Path, cell_file: Path | None) -> None:
    """Restore the files of an acceptance or undo that was interrupted between two
    files.

    One that changed all of its files was complete, and files that somebody changed
    since are left alone.
    """
    stored = _acceptances(file)
    if not stored:
        return
    back, states = _way_back(stored[-1], file, cell_file)
    if "before" in states and "changed" not in states:
        _write(back)
        _store(file, stored[:-1])


def _way_back(
    stored: Acceptance, file: Path, cell_file: Path | None
) -> tuple[list[Change], list[State]]:
    """Changes that restore the files of the acceptance `stored`, a model last, and the
    present state of each file: "before", "after" or "changed".
    """
    paths = _files_by_name(stored, file, cell_file)
    texts = {name: _text_at(path) for name, path in reversed(paths.items())}
    back = [Change(paths[n], text, stored.before[n]) for n, text in texts.items()]
    return back, [stored.state(name, text) for name, text in texts.items()]


def _store(file: Path, stored: tuple[Acceptance, ...]) -> None:
    """Write the record of the acceptances `stored` beside `file`, or delete that record
    where there are none.
    """
    path = _undo_path(file)
    if not stored:
        path.unlink(missing_ok=True)
        return
    text = UndoRecord(acceptances=stored).model_dump_json(by_alias=True, indent=1)
    if len(text) > LARGEST_UNDO:
        raise ConfigurationError(
            f"{path}: would exceed {LARGEST_UNDO // MEGABYTE} MB; move it away, with"
            " which acceptances so far can no longer be undone"
        )
    write_file(path, text)


def _acceptances(file: Path) -> tuple[Acceptance, ...]:
    """Acceptances into `file` that can still be undone, oldest first; empty where no
    record lies beside `file`.
    """
    path = _undo_path(file)
    if not path.exists():
        return ()
    content = read_json(path, LARGEST_UNDO)
    return parse(content, UndoRecord, str(path)).acceptances


def _undo_path(file: Path) -> Path:
    return file.with_name(file.name + UNDO)


def _files_by_name(
    stored: Acceptance, file: Path, cell_file: Path | None
) -> dict[str, Path]:
    """Paths of the files of an acceptance, by their stored names.

    Raises ConfigurationError for any but `file`, `cell_file` and accepted models in the
    folder of `file`.
    """
    given = {_relative(p, file): p for p in (file, cell_file) if p}
    folder = file.resolve().parent
    found = {}
    for name in stored.before:
        path = given.get(name, file.parent / name)
        is_model = name.endswith(ACCEPTED_MODEL)
        if name not in given and not (
            is_model and path.resolve().is_relative_to(folder)
        ):
            raise ConfigurationError(
                f"{_undo_path(file)}: names {name}, which is neither {file.name} nor"
                " the cell file; name the same --configs as for accept"
            )
        found[name] = path

    return found


def _write_all(changes: Sequence[Change]) -> None:
    """Make all of `changes` or, where one of them fails, take back those already made
    and raise its ConfigurationError.
    """
    try:
        _write(changes)
    except ConfigurationError:
        done = [change for change in changes if change.is_made]
        _write([Change(path, new, old) for path, old, new in done])
        raise


def _write(changes: Iterable[Change]) -> None:
    """Write the files in `changes` one by one, and delete each whose new text is the
    constant ABSENT, which stands for no file.

    Raises ConfigurationError where somebody has changed one meanwhile.
    """
    for change in changes:
        path, _, new = change
        if new == ABSENT:
            change.check()
            path.unlink(missing_ok=True)
        else:
            with writing(path):
                replace_file(path, encoded(new), change.check)


def _text_at(path: Path) -> str:
    """Text of the file at `path`, or the constant ABSENT where no file exists there."""
    return read_text(path, LARGEST_MODEL) if path.exists() else ABSENT


def _folders(*files: Path | None) -> list[Path]:
    """Folders that hold the given files, leaving out files that are None and folders
    that do not exist.
    """
    return [p.parent for p in files if p and p.parent.is_dir()]


def _check_patch(patch: Path) -> None:
    """Refuse a patch that is not a whole file of a strip or a mechanism."""
    if read_yaml(patch).get("kind") == "mechanism":
        load(patch, MechanismFile)
    else:
        load_strip(patch)


def _with_cell(text: str, path: Path, patch: Path) -> str:
    """The cell file's `text` with the effects and settings of `patch` merged in."""
    added = load(patch, Patch, bare=True)
    effects = added.effects
    check_effects(effects, origin=str(patch), of=["cell"])
    content = parse_yaml(text, str(path))
    _check_cell(content, path)
    merged = content | {"effects": (content.get("effects") or {}) | effects}

    for key, parts in (("fci", added.fci), ("twin", added.twin)):
        old: dict[str, Any] = content.get(key) or {}
        new = {k: (old.get(k) or {}) | part for k, part in parts.items()}
        if new:
            merged[key] = old | new

    _check_cell(merged, path)
    return edit_yaml(text, merged)


def _check_cell(content: Mapping[str, object], path: Path) -> None:
    """Refuse `content` that is no valid cell file; its section `twin` is not
    checked.
    """
    known = {key: value for key, value in content.items() if key != "twin"}
    parse(known, CellSettings, str(path))


def _check_writable(changes: Iterable[Change]) -> None:
    """Refuse paths that cannot be written before the first file is changed."""
    for change in changes:
        for place in (change.path, change.path.parent):
            if place.exists() and not os.access(place, os.W_OK):
                raise ConfigurationError(
                    f"{place}: cannot be written: permission denied; mend its"
                    " permissions"
                )


def _relative(path: Path, file: Path) -> str:
    """Path from the folder of `file`, as text."""
    return _utf8(os.path.relpath(path, file.parent))


def _name(path: Path) -> str:
    """Resolved path as text."""
    return _utf8(str(path.resolve()))


def _utf8(text: str) -> str:
    """`text` as UTF-8 can encode it, other characters escaped."""
    return encoded(text).decode()


def _digest(text: str) -> str:
    return hashlib.sha256(encoded(text)).hexdigest()
