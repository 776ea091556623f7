"""Runs a whole benchmark: measures the missing parts and collects all results."""

from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Protocol

from cell import parallel
from cell.benchmark.journal import Journal
from cell.benchmark.parts.all_parts import order, weights_digest
from cell.benchmark.parts.part import Part
from cell.benchmark.results import Refused, Result, Results
from cell.benchmark.spec import BenchmarkSpec
from cell.config.places import Configs
from cell.operations.calibrate import calibration_of
from cell.operations.fold import PACKAGES

JOURNAL = "parts.jsonl"


class Watcher(Protocol):
    """Observer of a benchmark's progress."""

    def begin(self, parts: Sequence[Part], known: Sequence[Part]) -> None:
        """Called first: `parts` are to be measured, of which `known` are already done."""
        ...

    def finished(self, part: Part, result: Result) -> None:
        """Called after each part."""
        ...


def benchmark(
    asked: BenchmarkSpec,
    configs: Configs,
    folder: Path,
    runs: Path,
    *,
    jobs: int,
    again: bool,
    watcher: Watcher,
) -> Results:
    """Measure the benchmark; parts that `folder` holds are not measured again, unless `again`.

    The folds are recorded in `runs`. Raises ConfigurationError for a folder that cannot be written,
    and for an invalid configuration.
    """
    settings = configs.cell()
    parts = order(asked, configs, runs)
    journal = Journal(folder / JOURNAL, again=again)
    found = {part.key: journal.get(part.key, part.of) for part in parts}
    results = {key: result for key, result in found.items() if result is not None}
    known = [part for part in parts if part.key in results]
    watcher.begin(parts, known)
    left = [part for part in parts if part.key not in results]
    if left:
        calibration_of(settings)  # made once, not by every fold at once
    for part, result in measured(left, jobs):
        if not isinstance(result, Refused):
            journal.put(part.key, part.of, result)
        results[part.key] = result
        watcher.finished(part, result)
    return Results(
        schema=1,
        asked=asked,
        made_with=made_with(settings.name),
        speed=settings.fold.speed,
        results=tuple(results[part.key] for part in parts),
    )


def measured(parts: Sequence[Part], jobs: int) -> Iterator[tuple[Part, Result]]:
    """Every part with its result, `jobs` at a time; one that cannot be measured is Refused."""
    for part, result in parallel.run(parts, jobs, _measure):
        if isinstance(result, parallel.Refusal):
            yield part, Refused(part=part.key, reason=result.reason)
        else:
            yield part, result


def _measure(part: Part) -> Result:
    return part.measure()


def made_with(cell: str) -> Mapping[str, str]:
    """Versions of libraries that affect the numbers, the weights' digest, the cell's name."""
    versions = {package: version(package) for package in PACKAGES}
    return {"cell": cell, "weights": weights_digest(), **versions}
