"""Folder of a fit: its results appear whole, and only a fit writes over them.

Results are written into a folder inside, STAGE, their record last. They are moved to
their places once that is there, by the fit itself or, after one that was killed, by the
next command. The record names each result with a digest, so that nobody takes a part of
a fit, or what somebody changed, for a whole one.
"""

import shutil
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Annotated

from pydantic import Field

from cell.gap.fitting.reml import Spread
from cell.gap.verdict.schema import StepKind, fit_folder
from cell.record.header import Recorded
from drivers.base.errors import ConfigurationError
from drivers.base.files import lock_folders, sync_folder, write_file, writing
from drivers.base.outputs import check_output_folder
from drivers.base.readers import MEGABYTE, file_digest, read_json
from drivers.base.settings import parse

RECORD, STAGE = "fit.json", ".fit.part"
VERDICT, PAGE, OVERLAY = "verdict.json", "report.html", "overlay.rrd"
CELL_PATCH = "cell-patch.yaml"
PATCHES: Mapping[StepKind, str] = {
    "accept": "patch.yaml",
    "accept_suspected": "suspect-patch.yaml",
    "accept_values": "base-patch.yaml",
    "accept_law": "law-patch.yaml",
}
"""File of the patch of each step that accepts something."""
MODELS = {"model": "model-patch.xml", "plain": "plain-model.xml"}
"""Models that a fit of a mechanism writes: for its own mode, and for MuJoCo alone."""
LAW = "law-"  # before the name of a model with the law
LARGEST_RECORD = 4 * MEGABYTE
FileName = Annotated[str, Field(pattern=r"^[\w-]+\.\w+$")]


class StoredLaw(Recorded):
    """Empirical law of residuals that a fit offered: amounts by the name of its
    terms.
    """

    terms: dict[str, float]


class PatchFiles(Recorded):
    """Names of the files that a step accepts: whole file of the `subject`, if any
    `model` and part of the `cell` file. The model is exported as the `plain` one.
    """

    subject: FileName
    model: FileName | None = None
    plain: FileName | None = None
    cell: FileName | None = None

    @property
    def names(self) -> list[str]:
        """Names of all files that the step accepts, without those that it lacks."""
        return [*filter(None, (self.subject, self.model, self.plain, self.cell))]


def patch_files(kind: StepKind, roles: Collection[str]) -> PatchFiles:
    """Names of the files that an operator's step of this `kind` accepts, out of those
    with the given `roles`, such as the subject's file or the cell's.
    """
    before = LAW if kind == "accept_law" else ""
    names = {role: before + name for role, name in MODELS.items()}
    names |= {"subject": PATCHES[kind], "cell": CELL_PATCH}
    return PatchFiles(**{role: names[role] for role in roles})


class FitRecord(Recorded):
    """Content of fit.json, the mark of a complete fit: what was fitted, what it offers.

    `file` is the path of the subject's file, whose digest was `file_sha256` as it was
    read, `parts` are those
    of model, included files and meshes by their paths from its folder, `cell_sha256`
    that of cell.yaml. `effects` are those of its patch, `values` of the base are
    outside what the file tolerates, `scatter` are quantities that differ from run to
    run, `law` describes what nothing explains. `patches` are the files that each step
    accepts, `results` the digests of all files of the fit.
    """

    file: str = ""
    file_sha256: str
    parts: dict[str, str] = Field(default_factory=dict)
    cell_sha256: str | None = None
    effects: tuple[str, ...]
    values: tuple[str, ...] = ()
    scatter: tuple[Spread, ...] = ()
    law: StoredLaw | None = None
    patches: dict[StepKind, PatchFiles]
    results: dict[FileName, str] = Field(default_factory=dict)

    @property
    def laws(self) -> tuple[str, ...]:
        """Names of the terms by which the fit describes residuals that no effect
        explains; empty where it offers no such description.
        """
        return tuple(self.law.terms) if self.law else ()


@contextmanager
def results_folder(out: Path) -> Iterator[Path]:
    """Context with an empty folder for the results of a fit, which replace those in the
    folder `out` at its end.

    They do once `finish` has been called; else `out` stays as it was. Other fits and
    acceptances are locked out. Raises ConfigurationError where `out` cannot be written,
    or holds files that no fit wrote at the places of results.
    """
    is_new = not out.exists()
    advice = "give a folder that can be written"
    with writing(out, advice):
        out.mkdir(parents=True, exist_ok=True)
    with lock_folders([out]):
        _complete_move(out)
        _check_own(out, _known_records(out))
        stage = out / STAGE
        try:
            with writing(out, advice):
                shutil.rmtree(stage, ignore_errors=True)
                stage.mkdir()
            yield stage
            _complete_move(out)
        finally:
            shutil.rmtree(stage, ignore_errors=True)
            if is_new:
                with suppress(OSError):  # results lie there
                    out.rmdir()


def check_replaceable(out: Path) -> None:
    """Raise ConfigurationError where the folder `out` holds files but no results of a
    fit or a check that may be replaced.

    To be asked before anything is read. Raises ConfigurationError.
    """
    if not (out / STAGE).is_dir():  # that a fit which was killed left
        check_output_folder(out, RECORD, "check.json")


def finish(stage: Path, record: FitRecord) -> None:
    """Write the `record` of a fit into the folder `stage`, which holds all its other
    results: that marks the fit as complete.
    """
    digests = {p.name: file_digest(p) for p in stage.iterdir()}
    whole = record.model_copy(update={"results": digests})
    write_file(stage / RECORD, whole.model_dump_json(by_alias=True, indent=1))


def _complete_move(out: Path) -> None:
    """Move the results of a finished fit to their places in the folder `out`, where
    they still wait in the subfolder in which they were written.

    Those of an earlier fit are replaced. Raises ConfigurationError where somebody has
    changed one of them, or has put another file at its place.
    """
    stage = out / STAGE
    mark = stage / RECORD
    if not mark.is_file():
        return

    new = _read(mark)
    earlier = _known_records(out)
    _check_own(out, [new, *earlier])

    with writing(out):
        for name in {name for record in earlier for name in record.results}:
            if name not in new.results:
                (out / name).unlink(missing_ok=True)
        for name in (*new.results, RECORD):
            with suppress(FileNotFoundError):  # it was moved before a fit was killed
                (stage / name).replace(out / name)
        sync_folder(out)
        stage.rmdir()


def read_record(out: Path) -> FitRecord:
    """Record of the complete fit in the folder `out`; moves its results into place
    first, if an interrupted fit has not.

    Raises ConfigurationError where there is none, or its verdict or a patch is missing
    or not as the fit wrote it. The folder is to be locked.
    """
    _complete_move(fit_folder(out))
    record = _read(out / RECORD)
    patches = [name for files in record.patches.values() for name in files.names]
    for name in (VERDICT, *patches):
        path = out / name
        if not path.is_file():
            raise ConfigurationError(f"{path}: is missing; fit again")
        if file_digest(path) != record.results.get(name):
            raise ConfigurationError(
                f"{path}: has changed since the fit wrote it; fit again"
            )

    return record


def _read(path: Path) -> FitRecord:
    try:
        return parse(read_json(path, LARGEST_RECORD), FitRecord, str(path))
    except ConfigurationError:
        if not path.exists():
            raise ConfigurationError(
                f"{path}: is missing; name the folder that `cell gap fit` was given"
                " with --out"
            ) from None
        raise ConfigurationError(
            f"{path}: is not as `cell gap fit` writes it; fit again, into a new folder"
        ) from None


def _known_records(out: Path) -> list[FitRecord]:
    record = out / RECORD
    return [_read(record)] if record.exists() else []


def _check_own(out: Path, records: Sequence[FitRecord]) -> None:
    """Raise ConfigurationError rather than write over a file in the folder `out` that
    is not as one of the `records` of its fits states.
    """
    names = {VERDICT, PAGE, OVERLAY, *PATCHES.values()}
    names |= {CELL_PATCH, *MODELS.values(), *(LAW + name for name in MODELS.values())}
    for name in sorted(names.union(*(record.results for record in records))):
        path = out / name
        if not path.exists():
            continue
        written = {record.results.get(name) for record in records}
        if file_digest(path) not in written:
            raise ConfigurationError(
                f"{path}: was not written by a fit, or was changed since; move it"
                " away, or name another --out"
            )
