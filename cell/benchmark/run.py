"""Runs a benchmark: lists its parts, measures the missing ones, collects all results."""

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from pydantic import TypeAdapter

import policies
from cell.benchmark.range_parts import HIDDEN_EFFECTS, EffectPart, RangePart
from cell.benchmark.results import AnyResult, BenchmarkSpec, ImageFold, MissingPart, Result, Results
from cell.calibrating.calibration_in_use import calibration_of
from cell.campaign.journal import Record, digest
from cell.campaign.run import Engine, Part, Watcher, carry_out
from cell.campaign.versions import code
from cell.config.places import Configs
from cell.devices.devices import DeviceSelection
from cell.folding.documents import PACKAGES
from cell.folding.fold import fold
from cell.folding.request import Request
from cell.report.words import millimetres

PART_COST = 10.0


@dataclass(frozen=True, slots=True)
class ImagePart:
    """Benchmark part: one fold through images by `request`; `of` is the digest of its inputs."""

    request: Request
    of: str
    cost: float = PART_COST

    @property
    def key(self) -> str:
        """Key with strip, policy and seed."""
        request = self.request
        return f"fold {request.strip.name} by {request.policy}, seed {request.choice.seed}"

    def measure(self) -> ImageFold:
        """Fold the strip and return the result, without a page: `cell report` makes that later."""
        done, strip = fold(self.request, calibration_of(self.request.cell)), self.request.strip
        stated = {name: getattr(strip, name) for name in ("bending_length", "retardation_time")}
        result = {name: getattr(done, name) for name in ImageFold.model_fields if name not in stated
                  and name != "kind"}  # fmt: skip
        return ImageFold(**stated, **result)


def order(spec: BenchmarkSpec, configs: Configs, runs: Path) -> tuple[Part, ...]:
    """All parts of a benchmark by its `spec`, the longest first; runs are written to `runs`."""
    speed = configs.cell().fold.speed
    return (*_simulated_parts(spec, speed), *_image_parts(spec, configs, runs))


def weights_digest(policy: str = "*") -> str:
    """Digest of the committed weights of `policy`, or of all policies."""
    folder = Path(policies.__file__).parent / "weights"
    files = sorted([*folder.glob(f"{policy}.json"), *folder.glob(f"{policy}.npz")])
    return digest(*(hashlib.sha256(path.read_bytes()).hexdigest() for path in files))


def _simulated_parts(spec: BenchmarkSpec, speed: float) -> Iterator[Part]:
    """Yield the parts without images: ranges and hidden effects."""
    extent = spec.extent
    for policy in spec.policies:
        of = digest(code(), weights_digest(policy))
        yield RangePart(policy, "rod", extent.grid, speed, of)
        yield RangePart(policy, "chain", extent.chain, speed, of)
        for effect in HIDDEN_EFFECTS:
            yield EffectPart(policy, effect, extent.hidden, speed, of)


def _image_parts(spec: BenchmarkSpec, configs: Configs, runs: Path) -> Iterator[Part]:
    for strip in spec.strips:
        for policy in spec.policies:
            yield _fold_request(spec, configs, runs, strip, policy, 0)
    for policy in spec.policies:
        for repeat in range(1, spec.repeats):
            yield _fold_request(spec, configs, runs, spec.repeated, policy, repeat)


def _fold_request(
    spec: BenchmarkSpec, configs: Configs, runs: Path, strip: str, policy: str, repeat: int
) -> ImagePart:
    """Part that folds a new `strip` by `policy`, with noise of the spec's seed plus `repeat`."""
    cell, lying = configs.cell(), configs.strip(strip)
    choice = DeviceSelection(seed=spec.seed + repeat)
    request = Request(cell, lying, policy, runs, choice)
    of = digest(code(), cell.model_dump_json(), lying.model_dump_json(), weights_digest(policy))
    return ImagePart(request, of)


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
    """Measure every part; yields its key and result, MissingPart where it could not be measured."""
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
        return MissingPart(part=record.key, reason=record.reason)
    return _ANY.validate_python(record.outcome, strict=False)


def made_with(cell: str) -> Mapping[str, str]:
    """Versions of libraries that affect the numbers, the weights' digest, the cell's name."""
    versions = {package: version(package) for package in PACKAGES}
    return {"cell": cell, "weights": weights_digest(), **versions}
