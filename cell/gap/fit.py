"""Implements `cell gap fit`: from measured runs and a subject's file to verdict and
patches.
"""

import itertools
import os
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from cell.gap.check import recordings, refuse
from cell.gap.diagnosis.held_out_gap import odd_runs
from cell.gap.diagnosis.lack_of_fit import order_suspicion
from cell.gap.fitting import CountedSimulation, Progress, Simulate, quiet
from cell.gap.investigate import in_all_runs, investigate
from cell.gap.open_subject import open_subject
from cell.gap.report.page import page
from cell.gap.selection import hold_out as hold
from cell.gap.subject.run_folders import copy_note, find_runs, without_copies
from cell.gap.subject.subject import Subject
from cell.gap.verdict import fit_folder
from cell.gap.verdict.compose import deviations, verdict as compose
from cell.gap.verdict.decision import next_steps
from cell.gap.verdict.findings import Findings
from cell.gap.verdict.fit_folder import FitRecord, PatchFiles, StoredLaw
from cell.gap.verdict.schema import StepKind, Values, Verdict
from cell.report.words import plural
from drivers.base.files import write_file
from drivers.base.readers import file_digest
from drivers.base.yaml_text import dump_yaml


@dataclass(frozen=True, slots=True)
class FitOptions:
    """Options of a fit: names of runs to `hold_out`, and of effects that the library is
    `without`.

    `unchecked` recordings are fitted even where `cell gap check` refuses them; `jobs`
    simulations run at once. `cell_file` takes effects of the cell, if any.
    """

    hold_out: Sequence[str] = ()
    without: Sequence[str] = ()
    unchecked: bool = False
    jobs: int = 1
    cell_file: Path | None = None


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
    ConfigurationError, and leaves `out` as it was, for bad input, where `out` holds
    something that no fit wrote, and where results cannot be written.
    """
    began = time.monotonic()
    hold_out = options.hold_out
    fit_folder.check_replaceable(out)
    cell_file = options.cell_file
    cell_digest = file_digest(cell_file) if cell_file else None
    folders = find_runs(runs)
    hold.check([run.name for run in folders], hold_out)
    distinct, copies = without_copies(folders)
    refuse([] if options.unchecked else recordings(distinct))
    subject = open_subject(file, distinct, options.jobs, options.without)
    contradictions = [*subject.contradictions()]
    refuse([] if options.unchecked else contradictions)
    progress(f"read {plural(len(folders), 'run')}", 0.0)

    simulate = CountedSimulation(subject.simulate)
    held_out = [copies.get(name, name) for name in hold_out]
    # matrices are small: threads only wait for each other
    with fit_folder.results_folder(out) as results, threadpool_limits(1, "blas"):
        held = hold.held_out(subject, simulate, held_out)
        findings = investigate(subject, held, simulate, progress)
        verdict = compose(findings, time.monotonic() - began, simulate.total)
        notes = itertools.starmap(copy_note, copies.items())
        remarks = [*notes, *map(str, contradictions)]
        remarks += _suspicions(findings, simulate)
        verdict = _with_remarks(verdict, subject, remarks)
        first, *others = next_steps(findings.decision, verdict, out, subject.origin)
        verdict = verdict.model_copy(update={"next": first, "alternatives": others})

        progress("write", 0.97)
        write_file(results / fit_folder.PAGE, page(findings, verdict))
        if overlay:
            overlay(findings, verdict, results / fit_folder.OVERLAY)
        write_file(results / fit_folder.VERDICT, verdict.to_json())
        patches = _write_patches(findings, verdict, results, out.name)
        fit_folder.finish(
            results, _record(findings, verdict, file, patches, cell_digest)
        )
    progress("done", 1.0)
    return verdict


def _suspicions(findings: Findings, simulate: Simulate) -> Iterator[str]:
    """Remarks on runs that contradict the others, and on values that change with the
    order of the runs.
    """
    every = in_all_runs(findings, simulate)
    yield from odd_runs(every, findings.quantities)
    if words := order_suspicion(every, np.random.default_rng(0)):
        yield words


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


def _record(
    findings: Findings,
    verdict: Verdict,
    file: Path,
    patches: dict[StepKind, PatchFiles],
    cell_digest: str | None,
) -> FitRecord:
    """Record of a fit of the subject in `file`, with digests of what was read."""
    digests = dict(findings.subject.origin.digests)
    file = file.resolve()
    own = digests.pop(file)
    law = findings.law
    return FitRecord(
        file=str(file),
        file_sha256=own,
        parts={os.path.relpath(p, file.parent): d for p, d in digests.items()},
        cell_sha256=cell_digest,
        effects=tuple(e.name for e in verdict.effects or verdict.suspected),
        values=tuple(d.parameter for d in verdict.deviates),
        scatter=findings.model_tests.scatter,
        law=StoredLaw(terms=law.terms) if law else None,
        patches=patches,
    )


def _write_patches(
    findings: Findings, verdict: Verdict, results: Path, name: str
) -> dict[StepKind, PatchFiles]:
    """Write a patch for each step that accepts something, into `results` of the fit
    `name`.
    """
    effects = {
        "accept": verdict.effects,
        "accept_suspected": verdict.suspected,
        "accept_values": (),
    }
    offered = {kind: verdict.values_with(some) for kind, some in effects.items()}
    if law := findings.law:
        terms = {name: {"amount": value} for name, value in law.terms.items()}
        offered["accept_law"] = law.base, terms
    return {
        kind: _write_patch(
            findings.subject, kind, values=offered[kind], results=results, name=name
        )
        for kind in (step.kind for step in verdict.steps)
        if kind in offered
    }


def _write_patch(
    subject: Subject, kind: StepKind, values: Values, results: Path, name: str
) -> PatchFiles:
    """Write the patch with `values` that the step `kind` accepts into `results`."""
    content, of_cell = subject.patch(*values, f"cell gap fit, {name}")
    texts = {"subject": dump_yaml(content), **subject.model_texts(*values)}
    if of_cell:
        texts["cell"] = dump_yaml(of_cell)

    files = fit_folder.patch_files(kind, texts)
    for role, text in texts.items():
        write_file(results / getattr(files, role), text)
    return files
