"""Checks of `cell gap check`: whether recordings can be fitted, and what they can
identify.
"""

from collections.abc import Iterator, Sequence
from functools import reduce
from itertools import combinations
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from cell.gap.fitting import Progress, quiet
from cell.gap.fitting.base_fit import (
    effect_responses,
    projection,
    stated_estimate,
    undetermined_values,
)
from cell.gap.open_subject import open_subject
from cell.gap.subject.run_folders import (
    TABLES,
    RunFolder,
    copy_note,
    find_runs,
    without_copies,
)
from cell.gap.subject.run_table import complaints, read_table
from cell.gap.subject.subject import Candidate, Finding, Level, Subject, bad
from cell.gap.verdict.schema import VerdictPart
from cell.report.html import Card, page
from cell.report.words import plural
from drivers.base.errors import ConfigurationError
from drivers.base.readers import read_yaml
from drivers.base.types import Array

# that the largest probe of an effect must show, beyond what the base absorbs
PROBE_SIGMA = 3.0
# of two responses: beyond it runs cannot separate the effects
LARGEST_CORRELATION = 0.995
IDENTIFIABLE = "not identifiable"
# groups of findings on a page
MEND = "Mend before anything is fitted"
RECORDINGS, SILENT = "Recordings", "What these runs cannot say"
HEADLINES: dict[Level, str] = {  # from the best to the worst level
    "good": "These runs can be fitted",
    "fair": "These runs can be fitted; mind the findings below",
    "bad": "Nothing should be fitted to these runs as they are",
}


class CheckReport(VerdictPart):
    """Content of check.json: the names of the runs that were checked, and findings on
    them.
    """

    schema_: Annotated[int, Field(alias="schema")] = 1
    runs: list[str]
    findings: list[Finding]

    @property
    def level(self) -> Level:
        """Worst level among the findings; `good` where there are none."""
        return max(
            (f.level for f in self.findings), key=[*HEADLINES].index, default="good"
        )

    def __str__(self) -> str:
        """Text of the check: its level, then a line for each finding."""
        lines = (
            f"\n  {f.level}  {f.run or 'all'}: {f.what}: {f.words}"
            for f in self.findings
        )
        return f"{self.level}{''.join(lines)}"

    __repr__ = __str__

    def to_json(self) -> str:
        """JSON text of check.json."""
        return self.model_dump_json(by_alias=True, indent=1) + "\n"


def recordings(runs: Sequence[RunFolder]) -> list[Finding]:
    """Findings on the tables of all `runs`; unreadable tables are skipped."""
    findings = []
    for run in runs:
        tables = {}
        for name in TABLES:
            try:
                tables[name] = read_table(run.path / name)
            except ConfigurationError:
                continue
        findings += [
            finding.model_copy(update={"run": run.name})
            for finding in complaints(tables)
        ]
    return findings


def refuse(findings: Sequence[Finding]) -> None:
    """Raise ConfigurationError where one of `findings` forbids a fit."""
    forbidding = [f for f in findings if f.level == "bad"]
    if forbidding:
        first, *others = forbidding
        more = f" (and {len(others)} more)" if others else ""
        raise ConfigurationError(
            f"{first}{more}; `cell gap check` lists all, --unchecked fits them all the"
            " same"
        )


def check(
    paths: Sequence[Path], file: Path, jobs: int = 1, shown: Progress = quiet
) -> CheckReport:
    """Check the runs at `paths` of the subject that `file` describes, without fitting
    anything.

    Raises ConfigurationError for fewer than two runs, or a `file` that is not YAML;
    what else cannot be read is a finding.
    """
    read_yaml(file)
    runs, copies = without_copies(find_runs(paths))
    shown(f"read {plural(len(runs), 'run')}", 0.0)
    findings = [
        Finding(
            what="copy",
            run=copy,
            words=copy_note(copy, first),
            remedy="measure it again",
        )
        for copy, first in copies.items()
    ]
    findings += recordings(runs)
    try:
        subject = open_subject(file, runs, jobs)
    except ConfigurationError as error:
        line = str(error).splitlines()[0]
        findings.append(bad("unreadable", line, "mend it"))
    else:
        findings += [
            Finding(what="run", words=words, remedy="") for words in subject.notes
        ]
        findings += subject.contradictions()
        shown("try each effect at its largest", 0.2)
        findings += unidentifiable(subject)
    return CheckReport(runs=[run.name for run in runs], findings=findings)


def unidentifiable(subject: Subject) -> Iterator[Finding]:
    """Findings on base values and effects that the runs cannot identify, from the
    responses of the runs to each of them.
    """
    stated = stated_estimate(subject, subject.simulate)
    for p, s in undetermined_values(stated):
        words = f"{p.name}: known to {p.spread:.2g} {p.unit}, by these runs to {s:.2g}"
        yield Finding(
            what=IDENTIFIABLE, words=words, remedy="move faster, higher or longer"
        )
    directions: dict[str, Array] = {}
    largest = [(c, _largest_probe(c)) for c in subject.scope.candidates]
    responses = effect_responses(
        subject.simulate, stated, [(c, [*p]) for c, p in largest]
    )
    unabsorbed = projection(stated, robustly=False).unabsorbed(responses)
    for (candidate, probe), response in zip(largest, unabsorbed.T, strict=True):
        name = candidate.name
        sigma = np.linalg.norm(response)
        if sigma >= PROBE_SIGMA:
            directions[name] = response / sigma
            continue
        k, *others = np.flatnonzero(probe != candidate.null)
        p = candidate.parameters[k]
        more = " and so on" if others else ""
        size = f"{p.name} {p.stated_value(probe[k]):.3g} {p.unit}".removesuffix(" 1")
        words = f"{name}: {size}{more} changes the runs by only {sigma:.1f} sigma"
        yield Finding(what=IDENTIFIABLE, words=words, remedy=candidate.revealed_by)
    for (first, a), (second, b) in combinations(directions.items(), 2):
        if abs(a @ b) > LARGEST_CORRELATION:
            words = (
                f"{first} and {second} change these runs alike: they cannot be"
                " separated"
            )
            yield Finding(
                what=IDENTIFIABLE, words=words, remedy="fit, then `cell gap advise`"
            )


def _largest_probe(candidate: Candidate) -> Array:
    """Values (k,) of a candidate effect at its largest probe in all k parameters; of
    several places the middle one.
    """
    null = candidate.null
    probes = candidate.probes
    amounts = [abs(group[0][0] - null[0]) for group in probes]
    largest = np.flatnonzero(np.equal(amounts, max(amounts)))
    members = map(np.array, probes[largest[len(largest) // 2]])
    return reduce(lambda mixed, probe: np.where(probe == null, mixed, probe), members)


def check_page(
    check: CheckReport, subject: str, drawn: Sequence[tuple[str, str, str]] = ()
) -> str:
    """HTML text of the self-contained page on a `check` of a subject's recordings;
    `drawn` are its names, figures and what is missing.
    """
    findings = check.findings
    level = check.level
    groups: dict[str, list[tuple[str, str, str]]] = {
        title: [] for title in (MEND, RECORDINGS, SILENT)
    }
    for f in findings:
        row = f.run or "all", f"{f.what}: {f.words}", f.remedy
        title = SILENT if f.what == IDENTIFIABLE else RECORDINGS
        groups[MEND if f.level == "bad" else title].append(row)
    count = f"{plural(len(findings), 'finding')}, {len(groups[MEND])} of them"
    return page(
        "gap/report/check.html",
        f"{subject}: check of its runs",
        kicker=f"Check of {plural(len(check.runs), 'run')}",
        name=subject,
        said=Card(level, HEADLINES[level], (f"{count} against a fit.",)),
        drawn=drawn,
        groups=[*groups.items()],
    )
