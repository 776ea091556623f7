"""Checks of `cell gap check`: whether recordings can be fitted, and what they can
identify.
"""

from collections.abc import Iterator, Mapping, Sequence
from functools import reduce
from itertools import combinations
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from cell.gap.fitting.base_fit import (
    effect_responses,
    stated_estimate,
    undetermined_values,
)
from cell.gap.fitting.projection import projection
from cell.gap.forward_selection import Progress, quiet
from cell.gap.open_subject import open_subject
from cell.gap.subject.run_folders import (
    TABLES,
    RunFolder,
    copy_note,
    find_runs,
    read_table,
    without_copies,
)
from cell.gap.subject.subject import Candidate, Finding, Level, Subject
from cell.gap.verdict.schema import Entry
from cell.report.html import page
from cell.report.page_verdict import PageVerdict
from cell.report.words import plural
from drivers.base.errors import ConfigurationError
from drivers.base.readers import read_yaml
from drivers.base.types import Array

SPARSE_COLUMNS = frozenset({"t", "contact_x", "contact_t", "pitch", "f_x", "f_z"})
"""Columns that hold numbers in some rows alone, or need not be there (formats.md)."""
# that the largest probe of an effect must show, beyond what the base absorbs
PROBE_SIGMA = 3.0
# of two responses: beyond it runs cannot separate the effects
LARGEST_CORRELATION = 0.995
IDENTIFIABLE = "not identifiable"
HEADLINES: dict[Level, str] = {  # from the best to the worst level
    "good": "These runs can be fitted",
    "fair": "These runs can be fitted; mind the findings below",
    "bad": "Nothing should be fitted to these runs as they are",
}


# Thresholds of complaints about a recording. Assumed: no fault was measured; runs of
# the twin and recordings of real pendulums stay within. Pairs are (worth a remark, not
# to be fitted).
LOST_ROWS = (0.02, 0.3)  # share that is missing or holds no number
LOST_IMAGES = (0.1, 0.6)  # share that is missing
STUCK = 0.2  # s that a reading stands still while its command changes by MOVED
MOVED = 0.01  # m or rad
CLIPPED = 0.05  # s that readings keep a largest or smallest value, more than once
# share of the median step of the clock by which the middle half of the steps differ
UNEVEN = 0.5


def clock(t: Array) -> Iterator[Finding]:
    """Findings on the times `t` (n,) [s] of rows: missing rows and uneven steps."""
    steps = np.diff(t)
    if not (steps > 0.0).all():  # the reader refuses rows out of order
        return
    lost = _missing(t)
    if lost > LOST_ROWS[0]:
        worst = int(np.argmax(steps))
        yield Finding(
            what="lost samples",
            words=(
                f"{100 * lost:.0f} % of the rows are missing, the longest gap "
                f"{steps[worst]:.2g} s at {t[worst]:.2f} s"
            ),
            remedy="record on a machine that keeps up, or leave the run out",
            level="bad" if lost > LOST_ROWS[1] else "fair",
        )
    low, high = np.quantile(steps, [0.25, 0.75])
    if high - low > UNEVEN * float(np.median(steps)):
        yield Finding(
            what="clock",
            words=(
                f"half of the steps between rows lie between {1e3 * low:.2g} and "
                f"{1e3 * high:.2g} ms, the others beyond"
            ),
            remedy="stamp a reading when it is made, not when it arrives",
        )


def images(t: Array) -> Iterator[Finding]:
    """Finding that images are missing, by gaps in the image times `t` (n,) [s] of
    profile points.

    A stamp may repeat: each point of a profile bears that of its image.
    """
    stamps = np.unique(t)
    if len(stamps) > 2 and (lost := _missing(stamps)) > LOST_IMAGES[0]:
        yield Finding(
            what="lost images",
            words=f"{100 * lost:.0f} % of the images are missing",
            remedy=(
                "look at light and segmentation where they are, or leave the run out"
            ),
            level="bad" if lost > LOST_IMAGES[1] else "fair",
        )


def _missing(t: Array) -> float:
    """Share of rows missing between times (n,) [s]: a step of k median steps lacks k -
    1 rows.
    """
    steps = np.diff(t)
    missing = np.round(np.maximum(steps / np.median(steps) - 1.0, 0.0)).sum()
    return float(missing / (missing + len(t)))


def values(
    name: str, t: Array, value: Array, command: Array | None = None
) -> Iterator[Finding]:
    """Findings on a column `value` (n,) at times `t` (n,) [s]: gaps, stuck and clipped
    readings.

    A reading is stuck that stands still while its `command` (n,) changes.
    """
    is_number = np.isfinite(value)
    lost = 1.0 - float(is_number.mean())
    if lost > LOST_ROWS[0]:
        yield Finding(
            what="lost samples",
            words=f"{name} holds no number in {100 * lost:.0f} % of the rows",
            remedy="mend the reading, or leave the run out",
        )
    if is_number.any():
        stuck = [] if command is None else [*_stall(name, t, value, command)]
        yield from stuck[:1] or _saturation(name, t, value, command)


def _stall(name: str, t: Array, value: Array, command: Array) -> Iterator[Finding]:
    """Findings on a reading that is constant while its command changes."""
    for first, last in _still(value):
        change = float(np.ptp(command[first : last + 1]))
        if t[last] - t[first] > STUCK and change > MOVED:
            yield Finding(
                what="stuck reading",
                words=(
                    f"{name} stands still at {value[first]:.4g} from {t[first]:.2f} to "
                    f"{t[last]:.2f} s while its command moves by {change:.2g}"
                ),
                remedy="mend the reading; leave the run out",
                level="bad",
            )


def _saturation(
    name: str, t: Array, value: Array, command: Array | None
) -> Iterator[Finding]:
    """Findings on a reading that stays at an end of its range, though any `command`
    moves on.
    """
    inner = [(a, b) for a, b in _still(value) if a > 0 and b < len(t) - 1]
    if command is not None:
        inner = [(a, b) for a, b in inner if np.ptp(command[a : b + 1]) > MOVED]
    for limit, word in ((np.nanmax(value), "largest"), (np.nanmin(value), "smallest")):
        long = [
            t[b] - t[a] for a, b in inner if value[a] == limit and t[b] - t[a] > CLIPPED
        ]
        if len(long) > 1:
            yield Finding(
                what="saturation",
                words=(
                    f"{name} stands {len(long)} times at its {word} value {limit:.4g},"
                    f" for {max(long):.2g} s at most"
                ),
                remedy="widen the range, or move less",
            )


def _still(value: Array) -> Iterator[tuple[int, int]]:
    """Yield first and last row of every stretch in which a column (n,) is constant."""
    edges = np.flatnonzero(np.diff(value) != 0.0)
    first = np.concatenate([[0], edges + 1])
    last = np.concatenate([edges, [len(value) - 1]])
    return ((int(a), int(b)) for a, b in zip(first, last, strict=True) if b > a)


def complaints(tables: Mapping[str, Mapping[str, Array]]) -> Iterator[Finding]:
    """Findings on the recorded tables of one run, given by file name as columns (n,) by
    name.
    """
    for file, columns in tables.items():
        t = columns.get("t")
        if t is None or len(t) < 3:
            continue
        if file == "profile.parquet":
            yield from images(t)
            continue
        yield from clock(t)
        for name, value in columns.items():
            if name not in SPARSE_COLUMNS and not name.endswith("_cmd"):
                command = columns.get(f"{name}_cmd")
                yield from values(name, t, value, command)


class Check(Entry):
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
    bad = [f for f in findings if f.level == "bad"]
    if bad:
        more = f" (and {len(bad) - 1} more)" if len(bad) > 1 else ""
        raise ConfigurationError(
            f"{bad[0]}{more}; `cell gap check` lists all, --unchecked fits them all the"
            " same"
        )


def check(
    paths: Sequence[Path], file: Path, jobs: int = 1, shown: Progress = quiet
) -> Check:
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
        findings.append(
            Finding(what="unreadable", words=line, remedy="mend it", level="bad")
        )
    else:
        findings += [
            Finding(what="run", words=words, remedy="") for words in subject.notes
        ]
        findings += subject.contradictions()
        shown("try each effect at its largest", 0.2)
        findings += unidentifiable(subject)
    return Check(runs=[run.name for run in runs], findings=findings)


def unidentifiable(subject: Subject) -> Iterator[Finding]:
    """Findings on values and effects that the runs do not identify, by responses at the
    base.
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
        sigma = float(np.linalg.norm(response))
        if sigma >= PROBE_SIGMA:
            directions[candidate.name] = response / sigma
            continue
        k, *others = np.flatnonzero(probe != candidate.null)
        p, more = candidate.parameters[k], " and so on" if others else ""
        size = f"{p.name} {p.stated_value(float(probe[k])):.3g} {p.unit}".removesuffix(
            " 1"
        )
        words = (
            f"{candidate.name}: {size}{more} changes the runs by only {sigma:.1f} sigma"
        )
        yield Finding(what=IDENTIFIABLE, words=words, remedy=candidate.revealed_by)
    for (first, a), (second, b) in combinations(directions.items(), 2):
        if abs(float(a @ b)) > LARGEST_CORRELATION:
            words = (
                f"{first} and {second} change these runs alike: they cannot be"
                " separated"
            )
            yield Finding(
                what=IDENTIFIABLE, words=words, remedy="fit, then `cell gap advise`"
            )


def _largest_probe(candidate: Candidate) -> Array:
    """Largest probe (k,) of a candidate, in all its parameters; of places the one in
    the middle.
    """
    amounts = [abs(group[0][0] - candidate.null[0]) for group in candidate.probes]
    largest = [i for i, amount in enumerate(amounts) if amount == max(amounts)]
    members = map(np.array, candidate.probes[largest[len(largest) // 2]])
    return reduce(
        lambda mixed, probe: np.where(probe == candidate.null, mixed, probe), members
    )


def check_page(
    check: Check, subject: str, drawn: Sequence[tuple[str, str, str]] = ()
) -> str:
    """HTML text of the self-contained page on a `check` of a subject's recordings, with
    those `drawn` (names, figures, what is missing).
    """
    bad = sum(f.level == "bad" for f in check.findings)
    count = f"{plural(len(check.findings), 'finding')}, {bad} of them against a fit."
    groups = {
        "Mend before anything is fitted": [
            f for f in check.findings if f.level == "bad"
        ],
        "Recordings": [
            f for f in check.findings if f.level == "fair" and f.what != IDENTIFIABLE
        ],
        "What these runs cannot say": [
            f for f in check.findings if f.what == IDENTIFIABLE
        ],
    }
    return page(
        "gap/report/check.html",
        f"{subject}: check of its runs",
        kicker=f"Check of {plural(len(check.runs), 'run')}",
        name=subject,
        said=PageVerdict(check.level, HEADLINES[check.level], (count,)),
        drawn=drawn,
        groups=[
            (title, [(f.run or "all", f"{f.what}: {f.words}", f.remedy) for f in some])
            for title, some in groups.items()
        ],
    )
