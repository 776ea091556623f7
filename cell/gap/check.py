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
from drivers.readers import LARGEST_TEXT, read_bytes, read_yaml
from drivers.types import Array

INPUT_FILES = ("run.yaml", "result.yaml", *TABLES)
PROBE_SIGMA = 3.0  # that the largest probe of an effect must show, beyond what the base absorbs
WEAK = 0.5  # of the prior spread of a value: runs that leave more do not determine it
LARGEST_CORRELATION = 0.995  # of two responses: beyond it runs cannot separate the effects
IDENTIFIABLE = "identifiable"
Level = Literal["bad", "fair", "good"]


class Finding(Entry):
    """One finding of a check: `bad` forbids a fit, `fair` costs accuracy.

    `run` is the name of a run, empty where the finding concerns all of them.
    """

    level: Level
    what: str
    run: str
    words: str
    remedy: str


class Check(Entry):
    """Content of check.json: the findings, and the hash of the inputs that they hold for."""

    schema_: Annotated[int, Field(alias="schema")] = 1
    inputs: str
    runs: list[str]
    findings: list[Finding]

    @property
    def level(self) -> Level:
        """Worst level among the findings, `good` where there are none."""
        found = {f.level for f in self.findings}
        return "bad" if "bad" in found else "fair" if "fair" in found else "good"

    def to_json(self) -> str:
        """Text of check.json."""
        return self.model_dump_json(by_alias=True, indent=1) + "\n"


def inputs_digest(file: Path, runs: Sequence[RunFolder]) -> str:
    """Hash of all that a fit of `runs` reads: the description `file`, its model, the recordings."""
    content = hashlib.sha256(read_bytes(file, LARGEST_TEXT))
    model = file.parent / str(read_yaml(file).get("model", "."))
    content.update(model.read_bytes() if model.is_file() else b"")
    for run in runs:
        for path in (run.path / name for name in INPUT_FILES):
            data = path.read_bytes() if path.is_file() else b"absent"
            content.update(path.name.encode() + data)
    return content.hexdigest()[:16]


def recordings(runs: Sequence[RunFolder]) -> list[Finding]:
    """Findings on the tables of `runs`, unreadable ones aside: their reader refuses those."""
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
    """Raise ConfigurationError where a recording has a finding that forbids a fit."""
    bad = [f for f in recordings(runs) if f.level == "bad"]
    if bad:
        more = f" (and {len(bad) - 1} more)" if len(bad) > 1 else ""
        raise ConfigurationError(
            f"{bad[0].run}: {bad[0].what}: {bad[0].words}; {bad[0].remedy}{more}; `cell gap check` "
            "lists all, --unchecked fits them all the same"
        )


def check(paths: Sequence[Path], file: Path, jobs: int = 1) -> Check:
    """Check the runs at `paths` of the subject that `file` describes, without fitting anything.

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
    """Findings on values and effects that the runs cannot identify, by linearised responses."""
    stated = nominal(subject, subject.simulate)
    sigma = np.sqrt(np.diag(normal_equations.covariance(stated.normal(1.0).curvature)))
    for p, s in zip(subject.scope.base, sigma, strict=False):
        if s > WEAK * p.spread:
            words = f"{p.name}: known to {p.spread:.2g} {p.unit}, by these runs to {s:.2g}"
            yield _finding(words, "move faster, higher or longer")
    about = projection(stated, robustly=False)
    library = [probe(stated, c) for c in subject.scope.candidates]
    directions: dict[str, Array] = {}
    for probed in run_all(subject.simulate, library):
        largest, name = _largest_response(about, probed), probed.candidate.name
        length = np.linalg.norm(largest)
        if length >= PROBE_SIGMA:
            directions[name] = largest / length
        else:
            words = f"{name}: even the largest that is tried would show by {length:.1f} sigma"
            yield _finding(words, probed.candidate.revealed_by)
    for (one, a), (other, b) in combinations(directions.items(), 2):
        if abs(float(a @ b)) > LARGEST_CORRELATION:
            words = f"{one} and {other} show alike: these runs cannot separate them"
            yield _finding(words, "fit, then `cell gap advise`")


def _finding(words: str, remedy: str) -> Finding:
    return Finding(level="fair", what=IDENTIFIABLE, run="", words=words, remedy=remedy)


def _largest_response(about: Projection, probed: Probed) -> Array:
    """Largest response (N,) of an effect to its own probes that the base cannot absorb."""
    firsts = np.concatenate([group[:, :1] for group in probed.responses[1:]], axis=1)
    left = about.left(firsts)
    return np.asarray(left[:, int(np.argmax(np.linalg.norm(left, axis=0)))])
