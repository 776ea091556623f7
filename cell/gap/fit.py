"""Implements `cell gap fit`: from measured runs and a subject's file to verdict and
patches.
"""

import itertools
import os
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from threadpoolctl import threadpool_limits

from cell.gap.check import recordings, refuse
from cell.gap.fitting.tasks import CountedSimulation
from cell.gap.forward_selection import Progress, quiet
from cell.gap.investigate import investigate
from cell.gap.open_subject import open_subject
from cell.gap.report.page import page
from cell.gap.selection import hold_out as hold
from cell.gap.subject.run_folders import copy_note, find_runs, without_copies
from cell.gap.subject.subject import Subject
from cell.gap.verdict import accept
from cell.gap.verdict.compose import deviations, verdict as compose
from cell.gap.verdict.decision import next_steps
from cell.gap.verdict.findings import Findings
from cell.gap.verdict.schema import Values, Verdict
from cell.report.words import plural
from drivers.base.errors import ConfigurationError
from drivers.base.files import write_file, writing
from drivers.base.yaml_text import dump_yaml


@dataclass(frozen=True, slots=True)
class FitOptions:
    """Options of a fit: names of runs to `hold_out`, and of effects that the library is
    `without`.

    `unchecked` recordings are fitted even where `cell gap check` refuses them; `jobs`
    simulations run at once.
    """

    hold_out: Sequence[str] = ()
    without: Sequence[str] = ()
    unchecked: bool = False
    jobs: int = 1


def fit(
    runs: Sequence[Path],
    file: Path,
    out: Path,
    options: FitOptions = FitOptions(),
    progress: Progress = quiet,
    overlay: Callable[[Findings, Verdict, Path], None] | None = None,
) -> Verdict:
    """Fit the runs of the subject in `file`; returns the verdict, which it writes into
    `out`.

    `overlay` writes a recording of measured and simulated runs to a path. Raises
    ConfigurationError, and leaves no verdict, for bad input.
    """
    began = time.monotonic()
    _clear(out)
    folders = find_runs(runs)
    hold.check([run.name for run in folders], options.hold_out)
    distinct, copies = without_copies(folders)
    refuse([] if options.unchecked else recordings(distinct))
    subject = open_subject(file, distinct, options.jobs, options.without)
    contradictions = [*subject.contradictions()]
    refuse([] if options.unchecked else contradictions)
    progress(f"read {plural(len(folders), 'run')}", 0.0)
    with writing(f"{out}", "give a folder that can be written"):
        out.mkdir(parents=True, exist_ok=True)
    simulate = CountedSimulation(subject.simulate)
    # matrices are small: threads only wait for each other
    with threadpool_limits(1, "blas"):
        held = hold.held_out(
            subject, simulate, [copies.get(n, n) for n in options.hold_out]
        )
        findings = investigate(subject, held, simulate, progress)
    verdict = compose(findings, time.monotonic() - began, simulate.total)
    remarks = [*itertools.starmap(copy_note, copies.items()), *map(str, contradictions)]
    verdict = _with_remarks(verdict, subject, remarks)
    first, *others = next_steps(findings.decision, verdict, out, subject.option)
    verdict = verdict.model_copy(update={"next": first, "alternatives": others})
    progress("write", 0.97)
    _write(findings, verdict, file, out)
    if overlay is not None:
        overlay(findings, verdict, out / "overlay.rrd")
    write_file(out / "verdict.json", verdict.to_json())
    progress("done", 1.0)
    return verdict


def _with_remarks(
    verdict: Verdict, subject: Subject, remarks: Iterable[str]
) -> Verdict:
    """`verdict` with `remarks` on its runs and on `subject`, and values that deviate
    from its file.
    """
    consequences = subject.consequences(*verdict.values_with(verdict.effects))
    notes = [*verdict.notes, *remarks, *subject.notes, *consequences]
    deviates = deviations(subject.scope.base, verdict.base)
    return verdict.model_copy(update={"notes": notes, "deviates": deviates})


def _write(findings: Findings, verdict: Verdict, file: Path, out: Path) -> None:
    """Write the record, the report and the patches of a fit; its verdict is written
    last.
    """
    record = accept.FitRecord(
        file_sha256=accept.sha256(file),
        effects=tuple(e.name for e in verdict.effects or verdict.suspected),
        values=tuple(d.parameter for d in verdict.deviates),
        scatter=findings.model_tests.scatter,
        law=findings.law and accept.StoredLaw(terms=findings.law.terms),
    )
    write_file(out / accept.RECORD, record.model_dump_json(by_alias=True, indent=1))
    write_file(out / "report.html", page(findings, verdict))
    if (law := findings.law) is not None:
        terms = {name: {"amount": value} for name, value in law.terms.items()}
        _write_patch(
            findings, out, accept.LAW_PATCH, accept.LAW_MODEL_PATCH, (law.base, terms)
        )
    if (name := _patch_name(findings, verdict)) is not None:
        values = verdict.values_with(verdict.effects or verdict.suspected)
        cell_patch = _write_patch(findings, out, name, accept.MODEL_PATCH, values)
        if cell_patch is not None:
            write_file(out / accept.CELL_PATCH, dump_yaml(cell_patch))


def _patch_name(findings: Findings, verdict: Verdict) -> str | None:
    """File name of the patch of effects or values to offer; None where there are
    none.
    """
    if verdict.effects:
        return accept.PATCH
    if verdict.suspected:
        return accept.SUSPECT_PATCH
    offers_values = verdict.deviates and not findings.accepted.model.effects
    return accept.BASE_PATCH if offers_values else None


def _write_patch(
    findings: Findings, out: Path, name: str, model: str, values: Values
) -> dict[str, object] | None:
    """Write the patch `name` and the `model` file, if there is one; returns the cell's
    patch.
    """
    patch, cell_patch = findings.subject.patch(*values, f"cell gap fit, {out.name}")
    write_file(out / name, dump_yaml(patch))
    text = findings.subject.model_text(*values)
    if text is not None:
        write_file(out / model, text)
    return cell_patch


def _clear(out: Path) -> None:
    """Delete the results of an earlier fit; ConfigurationError where none could be
    written.
    """
    first = next(p for p in (out.absolute(), *out.absolute().parents) if p.exists())
    if not first.is_dir() or not os.access(first, os.W_OK | os.X_OK):
        what = "cannot be written to" if first.is_dir() else "is a file"
        raise ConfigurationError(
            f"{out}: {first} {what}; give a folder that can be written"
        )
    patches = (
        *accept.PATCHES,
        accept.CELL_PATCH,
        accept.MODEL_PATCH,
        accept.LAW_MODEL_PATCH,
    )
    pages = (accept.RECORD, "report.html", "overlay.rrd")
    for name in ("verdict.json", *pages, *patches, accept.ACCEPTED):
        (out / name).unlink(missing_ok=True)
