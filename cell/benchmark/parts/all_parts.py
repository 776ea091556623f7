"""Lists the parts of a benchmark from its specification."""

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import policies
from cell.benchmark.parts.adaptation import Adapted
from cell.benchmark.parts.critical import Critical
from cell.benchmark.parts.evolution import LEVEL_MOTION, Evolved
from cell.benchmark.parts.hidden_effect import HIDDEN_EFFECTS, HiddenEffect
from cell.benchmark.parts.laid import LaidDown
from cell.benchmark.parts.paper_range import OverRange
from cell.benchmark.results import ImageFold
from cell.benchmark.spec import BenchmarkSpec
from cell.campaign.journal import digest
from cell.campaign.part import Part
from cell.campaign.versions import code
from cell.config.places import Configs, find_configs
from cell.devices.devices import DeviceSelection
from cell.folding.fold import Request, fold

LEVEL_SPEED = 0.02  # m/s, of the level motion
LEARNED = "feedback"  # the policy that the paper's figures of paths are about
PART_COST = 10.0


@dataclass(frozen=True, slots=True)
class ThroughImages:
    """Benchmark part: one fold through images by `request`; `of` is the digest of its inputs."""

    request: Request
    of: str
    cost: float = PART_COST

    @property
    def key(self) -> str:
        """Key with strip, policy and seed."""
        request = self.request
        return f"fold {request.strip} by {request.policy}, seed {request.choice.seed}"

    def measure(self) -> ImageFold:
        """Fold the strip and return the result, without a page: `cell report` makes that later."""
        done = fold(self.request, page=False)
        strip = find_configs(self.request.configs).strip(self.request.strip)
        return ImageFold(
            strip=done.strip,
            bending_length=strip.bending_length,
            retardation_time=strip.retardation_time,
            policy=done.policy,
            seed=done.seed,
            outcome=done.outcome,
            reason=done.reason,
            displacement=done.displacement,
            displacement_true=done.displacement_true,
            edge_offset_true=done.edge_offset_true,
            duration=done.duration,
            wall=done.wall,
            run=done.run,
        )


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
    """Yield the parts without images: ranges, hidden effects, critical points, shapes."""
    extent = spec.extent
    for policy in spec.policies:
        of = digest(code(), weights_digest(policy))
        yield OverRange(policy, "rod", extent.grid, speed, of)
        yield OverRange(policy, "chain", extent.chain, speed, of)
        for effect in HIDDEN_EFFECTS:
            yield HiddenEffect(policy, effect, extent.hidden, speed, of)
    of = digest(code())
    for pace in (LEVEL_SPEED, speed):
        yield Critical(pace, extent.heights, extent.stiffnesses, extent.dampings, of)
    for place in np.linspace(0.0, 1.0, extent.laid):
        yield LaidDown(float(place), of)
    yield Evolved(LEVEL_MOTION, LEVEL_SPEED, of)
    if LEARNED in spec.policies:
        of = digest(code(), weights_digest(LEARNED))
        yield Evolved(LEARNED, speed, of)
        yield Adapted(LEARNED, speed, of)


def _image_parts(spec: BenchmarkSpec, configs: Configs, runs: Path) -> Iterator[Part]:
    for strip in spec.strips:
        for policy in spec.policies:
            yield _fold_request(spec, configs, runs, strip, policy, 0)
    for policy in spec.policies:
        for repeat in range(1, spec.repeats):
            yield _fold_request(spec, configs, runs, spec.repeated, policy, repeat)


def _fold_request(
    spec: BenchmarkSpec, configs: Configs, runs: Path, strip: str, policy: str, repeat: int
) -> ThroughImages:
    """Part that folds a new `strip` by `policy`, with noise of the spec's seed plus `repeat`."""
    request = Request(
        strip=strip,
        policy=policy,
        checkpoint=None,
        choice=DeviceSelection(seed=spec.seed + repeat),
        runs=runs,
        configs=configs.folder,
        frames=None,
        truth=True,
        viz="off",
    )
    of = digest(
        code(),
        configs.cell().model_dump_json(),
        configs.strip(strip).model_dump_json(),
        weights_digest(policy),
    )
    return ThroughImages(request, of)
