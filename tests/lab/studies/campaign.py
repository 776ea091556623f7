"""Runs a study as a campaign, a part for each case, and reads its outcomes from the
journal.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from statistics import median
from typing import Any

from cell.base.campaign.journal import Cost, Journal, Record, digest
from cell.base.campaign.progress import Meter, duration_text
from cell.base.campaign.run import Engine, Part, carry_out
from cell.base.campaign.versions import code, data, sources
from cell.base.config.places import find_configs
from drivers.base.errors import ConfigurationError
from tests.lab.studies.study import Case, Measure, Outcome, Study

JOURNAL = "journal"
WORKING_PARTS = (
    *("tests/lab/exam", "tests/lab/faults", "tests/lab/studies/kit"),
    "tests/support/twin_calibration.py",
)


def measure_case(measure: Measure, case: Case, of: str) -> Mapping[str, Any]:
    """Measure a case of a study; returns its values with those of its outcome.

    Raises ConfigurationError where code or configuration are not those of the campaign,
    `of`.
    """
    if inputs(measure) != of:
        raise ConfigurationError(
            f"{measure.__module__}: this machine has other code or configuration than"
            " the campaign; install the same"
        )
    outcome = dict(measure(case.values))
    facts = {"seed": case.seed, "number": case.number, "case": dict(case.values)}
    return {**facts, "values": outcome}


@dataclass(frozen=True, slots=True)
class StudyRequest:
    """The requested cases of a study, and the folder that keeps them."""

    study: Study
    seed: int
    count: int
    folder: Path

    @property
    def journal(self) -> Path:
        """Folder of the study's journal."""
        return self.folder / JOURNAL

    def parts(self, shard: tuple[int, int] = (1, 1)) -> tuple[Part, ...]:
        """Parts of all cases, or of every n-th from the i-th on for the shard i of
        n.
        """
        study, (number, count) = self.study, shard
        of = inputs(study.measure)
        return tuple(
            Part(case.key, of, study.seconds, measure_case, (study.measure, case, of))
            for case in study.cases(self.seed, self.count)[number - 1 :: count]
        )


@dataclass(frozen=True, slots=True)
class StudyRecord:
    """Stored outcomes of the requested cases, by the version `of` the code.

    `lost` are cases that failed or were set aside, `other` is the number of other
    versions' ones.
    """

    asked: StudyRequest
    of: str
    outcomes: tuple[Outcome, ...]
    lost: tuple[Record, ...]
    other: int
    costs: tuple[Cost, ...] = ()


def measure(
    asked: StudyRequest,
    engine: Engine,
    meter: Meter,
    shard: tuple[int, int],
    *,
    again: bool,
) -> None:
    """Measure the cases that have no record in the journal; raises as `carry_out`."""
    parts = asked.parts(shard)
    for _ in carry_out(parts, asked.journal, engine, meter, again=again):
        pass


def read_study(asked: StudyRequest) -> StudyRecord:
    """Read the stored outcomes by the present code."""
    wanted = {case.key: case for case in asked.study.cases(asked.seed, asked.count)}
    found = [r for r in Journal(asked.journal).records() if r.key in wanted]
    of = inputs(asked.study.measure)
    mine = sorted((r for r in found if r.of == of), key=lambda r: r.key)
    failed, outcomes = asked.study.failed, []
    for r in mine:
        values = (
            failed(wanted[r.key].values) if r.outcome is None else r.outcome["values"]
        )
        outcomes += [Outcome(wanted[r.key], values)] if values else []
    lost = tuple(record for record in mine if record.outcome is None)
    costs = tuple(record.cost for record in mine if record.outcome is not None)
    return StudyRecord(asked, of, tuple(outcomes), lost, len(found) - len(mine), costs)


def cost(kept: StudyRecord) -> list[tuple[str, str]]:
    """Median, worst and total processor and wall time of the cases, as labelled
    texts.
    """
    if not kept.costs:
        return []
    processor = sorted(each.processor for each in kept.costs)
    return [
        (
            "a case, processor",
            f"{median(processor):.1f} s, worst {processor[-1]:.1f} s",
        ),
        ("a case, wall", f"{median(each.wall for each in kept.costs):.1f} s"),
        ("all, processor", duration_text(sum(processor))),
    ]


def inputs(measure: Measure) -> str:
    """Digest of product, laboratory and study code, and of the configuration."""
    made_of = digest(code(), data(), sources(WORKING_PARTS))
    return digest(made_of, _module_file(measure.__code__.co_filename), _configs())


@cache
def _module_file(path: str) -> str:
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


@cache
def _configs() -> str:
    h, folder = hashlib.sha256(), find_configs(None).folder
    for path in sorted(filter(Path.is_file, folder.rglob("*.yaml"))):
        h.update(str(path.relative_to(folder)).encode() + b"\0" + path.read_bytes())
    return h.hexdigest()
