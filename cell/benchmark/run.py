"""Runs a benchmark: measures its missing parts and collects all results."""

from importlib.metadata import version
from pathlib import Path

from pydantic import TypeAdapter

from cell.benchmark.parts import parts_of, weights_digest
from cell.benchmark.results import AnyResult, BenchmarkSpec, MissingPart, Result, Results
from cell.calibrate.calibration_in_use import calibration_of
from cell.campaign.journal import Record
from cell.campaign.progress import Meter
from cell.campaign.run import Engine, carry_out
from cell.config.places import Configs
from cell.folding.documents import PACKAGES
from cell.report.words import millimetres

JOURNAL = "parts"
_ANY: TypeAdapter[Result] = TypeAdapter(AnyResult)


def benchmark(
    spec: BenchmarkSpec,
    configs: Configs,
    folder: Path,
    runs: Path,
    *,
    engine: Engine,
    again: bool,
    meter: Meter,
) -> Results:
    """Measure the benchmark; parts that `folder` holds are not measured again, unless `again`.

    The folds are recorded in `runs`. Raises ConfigurationError for a folder that cannot be written,
    and for an invalid configuration.
    """
    settings = configs.cell()
    parts = parts_of(spec, configs, runs)
    calibration_of(settings)  # made once, not by every fold at once
    measured = carry_out(parts, folder / JOURNAL, engine, meter, again=again)
    results = {record.key: _result(record) for record in measured}
    return Results(
        schema=1,
        asked=spec,
        made_with={
            "cell": settings.name,
            "weights": weights_digest(),
            **{package: version(package) for package in PACKAGES},
        },
        speed=settings.fold.speed,
        results=tuple(results[part.key] for part in parts),
    )


def summarise(record: Record) -> str:
    """Result of a part in a few words, for the progress report."""
    if record.outcome is None:
        return f": {record.reason}"
    if record.outcome["kind"] == "fold":
        return f": {millimetres(record.outcome['displacement'], signed=True)}"
    return ""


def _result(record: Record) -> Result:
    """Result in a part's `record`, MissingPart where it could not be measured."""
    if record.outcome is None:
        return MissingPart(part=record.key, reason=record.reason)
    return _ANY.validate_python(record.outcome, strict=False)
