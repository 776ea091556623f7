"""Checks of `cell gap check`: whether recordings can be fitted, and what they can identify."""

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from itertools import combinations
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from cell.gap.diagnosis.recorded import complaints
from cell.gap.fitting import normal_equations
from cell.gap.fitting.projection import Projection, projection
from cell.gap.fitting.starts import nominal
from cell.gap.fitting.tasks import run_all
from cell.gap.opening import open_subject
from cell.gap.selection.screening import Probed, probe
from cell.gap.subject.copies import counted_once, note
from cell.gap.subject.run_folders import TABLES, RunFolder, find_runs, read_table
from cell.gap.subject.subject import Subject
from cell.gap.verdict.schema import Entry
from drivers.errors import ConfigurationError
from drivers.files import TEXT, read_bytes
from drivers.settings import read_yaml
from drivers.types import Array

INPUT_FILES = ("run.yaml", "result.yaml", *TABLES)
PROBE_SIGMA = 3.0  # by which the largest probe of an effect must show, once the base has moved
WEAK = 0.5  # of what was known of a quantity before: runs that leave more say little of it
# correlation of responses, from which on runs cannot separate two effects
LARGEST_CORRELATION = 0.995
Level = Literal["bad", "fair", "good"]


class Finding(Entry):
    """One line of the page: `bad` where nothing should be fitted, `fair` where something is lost.

    `run` is empty where it concerns all of them.
    """

    level: Level
    what: str
    run: str
    words: str
    remedy: str


class Check(Entry):
    """check.json: the findings on the inputs of this hash."""

    schema_: Annotated[int, Field(alias="schema")] = 1
    inputs: str
    runs: list[str]
    findings: list[Finding]

    @property
    def level(self) -> Level:
        """The worst level of all findings."""
        found = {f.level for f in self.findings}
        return "bad" if "bad" in found else "fair" if "fair" in found else "good"

    def to_json(self) -> str:
        """Text of check.json."""
        return self.model_dump_json(by_alias=True, indent=1) + "\n"


def inputs_digest(file: Path, runs: Sequence[RunFolder]) -> str:
    """Hash of everything that a fit of `runs` reads, the description in `file` with its model."""
    h = hashlib.sha256(read_bytes(file, TEXT))
    model = file.parent / str(read_yaml(file).get("model", "."))
    h.update(model.read_bytes() if model.is_file() else b"")
    for run in runs:
        for path in (run.path / name for name in INPUT_FILES):
            h.update(path.name.encode() + (path.read_bytes() if path.is_file() else b"absent"))
    return h.hexdigest()[:16]


def recordings(runs: Sequence[RunFolder]) -> list[Finding]:
    """Findings on the recordings as such; unreadable ones are refused by their reader."""
    found = []
    for run in runs:
        tables = {}
        for name in TABLES:
            try:
                tables[name] = read_table(run.path / name)
            except ConfigurationError:
                continue
        found += [Finding(run=run.name, **asdict(each)) for each in complaints(tables)]
    return found


def refuse(runs: Sequence[RunFolder]) -> None:
    """Raise ConfigurationError where a recording is such that nothing should be fitted to it."""
    bad = [f for f in recordings(runs) if f.level == "bad"]
    if bad:
        more = f" (and {len(bad) - 1} more)" if len(bad) > 1 else ""
        raise ConfigurationError(
            f"{bad[0].run}: {bad[0].what}: {bad[0].words}; {bad[0].remedy}{more}; `cell gap check` "
            "lists all, --unchecked fits them all the same"
        )


def check(paths: Sequence[Path], file: Path, jobs: int = 1) -> Check:
    """Every finding on the runs at `paths` of what `file` describes; nothing is fitted.

    Raises ConfigurationError where there are no runs; what else cannot be read is a finding.
    """
    runs, copies = counted_once(find_runs(paths))
    found = [
        Finding(level="fair", what="copy", run=copy, words=note(copy, first),
                remedy="measure again; a copy says nothing new")
        for copy, first in copies.items()
    ]  # fmt: skip
    found += recordings(runs)
    try:
        subject = open_subject(file, runs, jobs)
    except ConfigurationError as error:
        words, _, remedy = str(error).splitlines()[0].partition("; ")
        found.append(Finding(level="bad", what="unreadable", run="", words=words, remedy=remedy))
    else:
        found += [
            Finding(level="fair", what="run", run="", words=words, remedy="make it again")
            for words in subject.notes
        ]
        found += identifiable(subject)
    names = [run.name for run in runs]
    return Check(inputs=inputs_digest(file, runs), runs=names, findings=found)


def identifiable(subject: Subject) -> Iterator[Finding]:
    """Findings on what these motions cannot identify, by responses at the stated values."""
    stated = nominal(subject, subject.simulate)
    sigma = np.sqrt(np.diag(normal_equations.covariance(stated.normal(1.0).curvature)))
    for p, s in zip(subject.scope.base, sigma, strict=False):
        if s > WEAK * p.spread:
            yield Finding(
                level="fair", what="identifiable", run="", remedy="move faster, higher or longer",
                words=f"{p.name}: known to {p.spread:.2g} {p.unit}, by these runs to {s:.2g}",
            )  # fmt: skip
    about = projection(stated, robustly=False)
    library = [probe(stated, c) for c in subject.scope.candidates]
    shown: dict[str, Array] = {}
    for probed in run_all(subject.simulate, library):
        left, name = _largest(about, probed), probed.candidate.name
        if np.linalg.norm(left) >= PROBE_SIGMA:
            shown[name] = left / np.linalg.norm(left)
            continue
        yield Finding(
            level="fair", what="identifiable", run="",
            words=f"{name}: even the largest that is tried would show by "
            f"{np.linalg.norm(left):.1f} sigma", remedy=probed.candidate.revealed_by,
        )  # fmt: skip
    for (one, a), (other, b) in combinations(shown.items(), 2):
        if abs(float(a @ b)) > LARGEST_CORRELATION:
            yield Finding(
                level="fair", what="identifiable", run="", remedy="fit, then `cell gap advise`",
                words=f"{one} and {other} show alike: these runs cannot separate them",
            )  # fmt: skip


def _largest(about: Projection, probed: Probed) -> Array:
    """The largest response (N,) of an effect to its probes, once the base has moved against it."""
    ways = np.concatenate([group[:, :1] for group in probed.responses[1:]], axis=1)
    left = about.left(ways)
    return np.asarray(left[:, int(np.argmax(np.linalg.norm(left, axis=0)))])
