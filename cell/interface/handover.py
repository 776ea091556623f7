"""What a fit hands on to other programs, a model or ranges, and how well a model that
MuJoCo alone loads replays measured runs.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os.path import relpath
from pathlib import Path
from typing import Literal

from cell.gap.diagnosis.held_out_gap import fit_held_out, floor, sizes
from cell.gap.fitting import Progress, quiet
from cell.gap.fitting.model import Model
from cell.gap.open_subject import open_mechanism
from cell.gap.subject.mechanism.mechanism_file import MechanismFile
from cell.gap.subject.mechanism.model_source import ModelSource, with_assets
from cell.gap.subject.mechanism.patch import NOT_SAID, remark_in
from cell.gap.subject.mechanism.read_mechanism import model_place
from cell.gap.subject.run_folders import find_runs
from cell.gap.subject.subject import Subject, starts
from cell.gap.verdict.accept import LARGEST_MODEL, offered
from cell.gap.verdict.fit_folder import (
    VERDICT,
    FitRecord,
    PatchFiles,
    read_record,
)
from cell.gap.verdict.schema import fit_folder, read_verdict
from cell.setup.strips.export_strip import export_strips
from drivers.base.errors import ConfigurationError
from drivers.base.files import lock_folders, new_folder, write_file
from drivers.base.readers import read_bytes, read_text, read_yaml
from drivers.base.settings import load
from drivers.base.yaml_text import dump_yaml
from drivers.strip.describe import load_strip
from drivers.strip.effects import registry

RANGES, RANGES_VERSION = "ranges.yaml", 2  # 1 named no subject
APART = "values together: each range is that of one alone"


def export_fit(
    fit: Path, kind: Literal["mjcf", "ranges"], out: Path
) -> dict[Path, tuple[str, ...]]:
    """Write what the fit in the folder `fit` found into the new folder `out`: its model
    as MJCF, or ranges of its values; returns what the files cannot say.

    Raises ConfigurationError for a fit that is not whole or of an older version, for a
    model where nothing was named, and where `out` is there already.
    """
    with lock_folders([fit_folder(fit)]):
        record = read_record(fit)
        if kind == "ranges":
            return _export_ranges(record, fit, out)
        files = offered(fit, record)
        if files.model:
            return _export_mechanism(record, files, fit, out)
        effects = read_yaml(fit / files.cell)["effects"] if files.cell else ()
        of_cell = [registry()[name].sentence for name in effects]
        return export_strips([load_strip(fit / files.subject)], "mjcf", out, of_cell)


def _export_mechanism(
    record: FitRecord, files: PatchFiles, fit: Path, out: Path
) -> dict[Path, tuple[str, ...]]:
    """Write the plain model of a mechanism, and the meshes that it names."""
    origin = Path(record.file)
    if files.plain is None:
        raise ConfigurationError(
            f"{fit}: an older version fitted, without a model for MuJoCo alone; fit"
            f" again: cell gap fit RUNS --model {origin} --out NEW"
        )
    text = read_text(fit / files.plain, LARGEST_MODEL)
    file = load(fit / files.subject, MechanismFile)
    model = model_place(file, origin)
    source = with_assets(ModelSource(text, model.parent, origin.parent), f"{model}")

    with new_folder(out) as folder:
        for path, digest in source.digests.items():
            name = relpath(path, origin.parent)
            if digest != record.parts.get(name):
                raise ConfigurationError(
                    f"{path}: has changed since it was fitted; fit again"
                )
            write_file(folder / name, read_bytes(path, LARGEST_MODEL))
        write_file(model_place(file, folder / origin.name), text)

    return {out / file.model: _not_said(text)}


def _not_said(text: str) -> tuple[str, ...]:
    """What a model's text states that it cannot say."""
    return tuple(filter(None, remark_in(text, NOT_SAID).split("; ")))


def _export_ranges(
    record: FitRecord, fit: Path, out: Path
) -> dict[Path, tuple[str, ...]]:
    """Write the 95 % intervals of base and named effects; an end that is not known is
    null.
    """
    verdict = read_verdict(fit / VERDICT)
    values = dict(verdict.base)
    for effect in verdict.effects:
        values |= {f"{effect.name}.{n}": v for n, v in effect.parameters.items()}
    content = {
        "format": "folding-cell ranges",
        "version": RANGES_VERSION,
        "fit": fit.resolve().name,
        "subject": Path(record.file).name,
        "verdict": verdict.verdict,
        "not_said": [APART],
        "units": "SI where none is stated",
        "ranges": [{"parameter": n, **v.model_dump()} for n, v in values.items()],
    }
    with new_folder(out) as folder:
        write_file(folder / RANGES, dump_yaml(content))
    return {out / RANGES: (APART,)}


@dataclass(frozen=True, slots=True)
class ReplayedGap:
    """Gap of measured runs by quantity, rms, `before` and `after` another model, and
    their noise `floor`.

    `not_said` are effects that this model cannot state.
    """

    before: Mapping[str, float]
    after: Mapping[str, float]
    floor: Mapping[str, float]
    not_said: Sequence[str]


def replay(
    runs: Sequence[Path],
    file: Path,
    model: Path,
    jobs: int = 1,
    shown: Progress = quiet,
) -> ReplayedGap:
    """Replay measured `runs` of the mechanism in `file` with its own model, and with
    the MJCF `model` alone, `jobs` simulations at a time.

    Only the initial state of a run is fitted. Raises ConfigurationError for bad input.
    """
    folders = find_runs(runs)
    stated = open_mechanism(file, folders, jobs)
    plain = open_mechanism(file, folders, jobs, model=model)
    shown("replay with the stated model", 0.0)
    before = _gap(stated)
    shown("replay with the other model", 0.5)
    return ReplayedGap(
        before=before,
        after=_gap(plain),
        floor=floor(plain.runs, plain.scope.quantities),
        not_said=_not_said(read_text(model, LARGEST_MODEL)),
    )


def _gap(subject: Subject) -> dict[str, float]:
    """Rms residuals of all runs of a `subject` as stated, by quantity."""
    base = subject.scope.base
    held = Model(base).holding(starts(base))
    found = fit_held_out(subject.simulate, held, subject.runs)
    return sizes(found, subject.scope.quantities)
