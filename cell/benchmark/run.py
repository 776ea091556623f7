"""Runs a whole benchmark: measures the missing parts and collects all results."""

from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path

from pydantic import TypeAdapter

from cell.benchmark.parts.all_parts import order, weights_digest
from cell.benchmark.results import AnyResult, Refused, Result, Results
from cell.benchmark.spec import BenchmarkSpec
from cell.calibrating.calibrate import calibration_of
from cell.campaign.journal import Record
from cell.campaign.part import Part
from cell.campaign.run import Engine, Watcher, carry_out
from cell.config.places import Configs
from cell.folding.fold import PACKAGES
from cell.report.words import millimetres

JOURNAL = "parts"
_ANY: TypeAdapter[Result] = TypeAdapter(AnyResult)


def benchmark(
    asked: BenchmarkSpec,
    configs: Configs,
    folder: Path,
    runs: Path,
    *,
    engine: Engine,
    again: bool,
    watcher: Watcher,
) -> Results:
    """Measure the benchmark; parts that `folder` holds are not measured again, unless `again`.

    The folds are recorded in `runs`. Raises ConfigurationError for a folder that cannot be written,
    and for an invalid configuration.
    """
    settings = configs.cell()
    parts = order(asked, configs, runs)
    calibration_of(settings)  # made once, not by every fold at once
    found = dict(measure_parts(parts, folder / JOURNAL, engine, watcher, again=again))
    return Results(
        schema=1,
        asked=asked,
        made_with=made_with(settings.name),
        speed=settings.fold.speed,
        results=tuple(found[part.key] for part in parts),
    )


def measure_parts(
    parts: Sequence[Part], folder: Path, engine: Engine, watcher: Watcher, *, again: bool = False
) -> Iterator[tuple[str, Result]]:
    """Measure every part; yields its key and result, Refused where it could not be measured."""
    for part, record in carry_out(parts, folder, engine, watcher, again=again):
        yield part.key, _result(record)


def summarise(record: Record) -> str:
    """Result of a part in a few words, for the progress report."""
    if record.outcome is None:
        return f": {record.reason}"
    if record.outcome["kind"] == "fold":
        return f": {millimetres(record.outcome['displacement'], signed=True)}"
    return ""


def _result(record: Record) -> Result:
    if record.outcome is None:
        return Refused(part=record.key, reason=record.reason)
    return _ANY.validate_python(record.outcome, strict=False)


def made_with(cell: str) -> Mapping[str, str]:
    """Versions of libraries that affect the numbers, the weights' digest, the cell's name."""
    versions = {package: version(package) for package in PACKAGES}
    return {"cell": cell, "weights": weights_digest(), **versions}
