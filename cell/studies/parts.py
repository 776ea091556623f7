"""Parts of a benchmark, folds through images or in simulation alone, and how they are
run.
"""

import hashlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from importlib.metadata import version
from pathlib import Path

import numpy as np
from pydantic import TypeAdapter

import policies
from cell.base.campaign.journal import Record, digest
from cell.base.campaign.run import Part
from cell.base.campaign.versions import code
from cell.base.config.places import Configs
from cell.base.devices.devices import Trial
from cell.folding.documents import PACKAGES
from cell.folding.fold import fold
from cell.folding.request import Request
from cell.report.words import millimetres
from cell.setup.calibration_in_use import calibration_of
from cell.studies.evaluation import EngineName, stepper
from cell.studies.results import (
    AnyResult,
    BenchmarkSpec,
    EffectFolds,
    ImageFold,
    MissingPart,
    RangeFolds,
    Result,
    Results,
    finite_or_none,
)
from drivers.strip.describe import describe
from drivers.strip.engine import Stepper
from drivers.strip.file import StripFile
from policies.planned import Planned
from policies.registry import make_policy
from policies.rollout import Folds, Rollout, roll_out
from policies.sensing import IMAGE_SENSING
from policies.strip_sampling import (
    EFFECTS,
    draw_effect,
    draw_friction,
    grid,
    plain_strip,
)

FRICTION_EFFECT = "bending_hysteresis"
YIELD_RANGE = (20.0, 60.0)  # 1/m, as laboratories measure it
HIDDEN_EFFECTS = ("", FRICTION_EFFECT, *EFFECTS)
"""Effects that are hidden in turn; the empty name stands for none."""
STRIP_COST = {"rod": 0.03, "chain": 0.3}  # s for a fold of one strip
PLANNING_FOLDS = 16  # folds of the rod, about, that planning takes
EFFECT_COST = 0.1  # s for a fold with an effect
PLANNED_COST = 5  # times as much where the fold is planned
IMAGES_COST = 10.0  # s of a fold through images
JOURNAL = "parts"
Measure = Callable[[Sequence[Part]], Iterable[Record]]
_ANY: TypeAdapter[Result] = TypeAdapter(AnyResult)


def parts_of(spec: BenchmarkSpec, configs: Configs, runs: Path) -> tuple[Part, ...]:
    """All parts of a benchmark by its `spec`, the longest first; runs are written to
    `runs`.
    """
    speed = configs.cell().fold.speed
    return (*_simulated_parts(spec, speed), *_image_parts(spec, configs, runs))


def _weights_digest(policy: str = "*") -> str:
    """Digest of the committed weights of `policy`, or of all policies."""
    folder = Path(policies.__file__).parent / "weights"
    files = sorted([*folder.glob(f"{policy}.json"), *folder.glob(f"{policy}.npz")])
    return digest(*(hashlib.sha256(path.read_bytes()).hexdigest() for path in files))


def _simulated_parts(spec: BenchmarkSpec, speed: float) -> Iterator[Part]:
    """Yield the parts without images: ranges of strips, and strips with hidden
    effects.
    """
    size = spec.extent
    for policy in spec.policies:
        of = digest(code(), _weights_digest(policy))
        plans = policy == Planned.name
        sides: tuple[tuple[EngineName, int], ...] = (
            ("rod", size.grid),
            ("chain", size.chain),
        )
        for engine, side in sides:
            key = f"{policy} over {side} x {side} on the {engine} at {speed}"
            planning = (PLANNING_FOLDS if plans else 1) * STRIP_COST["rod"]
            cost = side**2 * (STRIP_COST[engine] + planning)
            yield Part(
                key=key,
                of=of,
                cost=cost,
                function=fold_range,
                arguments=(policy, engine, side, speed),
            )
        for name in HIDDEN_EFFECTS:
            key = f"{policy} on {size.hidden} strips with {name or 'nothing'} hidden"
            cost = size.hidden * EFFECT_COST * (PLANNED_COST if plans else 1)
            yield Part(
                key=key,
                of=of,
                cost=cost,
                function=fold_effect,
                arguments=(policy, name, size.hidden, speed),
            )


def _image_parts(spec: BenchmarkSpec, configs: Configs, runs: Path) -> Iterator[Part]:
    """Yield the folds through images: every strip once, then the repeats with the next
    seeds.
    """
    firsts = [(strip, policy, 0) for strip in spec.strips for policy in spec.policies]
    repeats = [
        (spec.repeated, policy, k)
        for policy in spec.policies
        for k in range(1, spec.repeats)
    ]
    for name, policy, repeat in (*firsts, *repeats):
        cell = configs.cell()
        strip = configs.strip(name)
        seed = spec.seed + repeat
        inputs = (
            cell.model_dump_json(),
            strip.model_dump_json(),
            _weights_digest(policy),
        )
        request = Request(cell, strip, policy, runs, trial=Trial(seed=seed))
        key = f"fold {strip.name} by {policy}, seed {seed}"
        yield Part(
            key=key,
            of=digest(code(), *inputs),
            cost=IMAGES_COST,
            function=_fold_images,
            arguments=(request,),
        )


def _fold_images(request: Request) -> ImageFold:
    """Fold a strip through images by `request`; its page is not written."""
    result = fold(request, calibration_of(request.cell))
    stated = {
        name: getattr(request.strip, name)
        for name in ("bending_length", "retardation_time")
    }
    measured = ImageFold.model_fields.keys() - {"kind", *stated}
    return ImageFold(**stated, **{name: getattr(result, name) for name in measured})


def fold_range(policy: str, engine: EngineName, side: int, speed: float) -> RangeFolds:
    """Fold a logarithmic grid of side x side strips in `engine` by `policy` at `speed`
    [m/s].

    A policy that uses images gets late and noisy observations, as in training.
    """
    strips = grid(side)
    rng = np.random.default_rng(0)
    folds = _fold_known(
        policy,
        known=strips,
        strips=strips,
        engine=stepper(engine),
        settings=Rollout(speed=speed),
        rng=rng,
    )
    return RangeFolds(
        policy=policy,
        engine=engine,
        side=side,
        displacement=finite_or_none(folds.displacement),
        force=tuple(folds.pull.tolist()),
    )


def fold_effect(policy: str, name: str, count: int, speed: float) -> EffectFolds:
    """Fold `count` random strips in the rod by `policy`, which does not know their
    effect `name`.

    Every policy folds the same strips at `speed` [m/s], observed as through images.
    """
    rng = np.random.default_rng(1)
    strips = [_strip_with(name, rng) for _ in range(count)]
    known = [strip.model_copy(update={"effects": {}}) for strip in strips]
    settings = Rollout(speed=speed, sensing=IMAGE_SENSING)
    folds = _fold_known(
        policy, known, strips, engine=stepper("rod"), settings=settings, rng=rng
    )
    return EffectFolds(
        policy=policy, effect=name, displacement=finite_or_none(folds.displacement)
    )


def _fold_known(
    policy: str,
    known: Sequence[StripFile],
    strips: Sequence[StripFile],
    engine: Stepper,
    settings: Rollout,
    rng: np.random.Generator,
) -> Folds:
    """Fold `strips` side by side in `engine` by `policy`, which takes them for the
    `known` ones.
    """
    decide = (
        Planned(known) if policy == Planned.name else make_policy(policy, in_rod=True)
    )
    models = [describe(strip) for strip in strips]
    return roll_out(decide, engine, known[0], models, settings=settings, rng=rng)


def _strip_with(name: str, rng: np.random.Generator) -> StripFile:
    """Draw a random strip with the effect `name`, with none for an empty name."""
    if name == FRICTION_EFFECT:
        return plain_strip(rng, bending_hysteresis=draw_friction(rng, *YIELD_RANGE))
    bare = plain_strip(rng)
    if not name:
        return bare
    return bare.model_copy(update={"effects": {name: draw_effect(name, rng)}})


def benchmark(
    spec: BenchmarkSpec, configs: Configs, runs: Path, measure: Measure
) -> Results:
    """Results of the benchmark `spec`, its parts measured by `measure`, their folds in
    `runs`.

    Raises ConfigurationError for an invalid configuration.
    """
    settings = configs.cell()
    parts = parts_of(spec, configs, runs)
    calibration_of(settings)  # made once, not by every fold at once
    results = {record.key: _result(record) for record in measure(parts)}
    return Results(
        schema=1,
        asked=spec,
        made_with={
            "cell": settings.name,
            "weights": _weights_digest(),
            **{package: version(package) for package in PACKAGES},
        },
        speed=settings.fold.speed,
        results=tuple(results[part.key] for part in parts),
    )


def summarise(record: Record) -> str:
    """Result of a part in a few words, for the progress report."""
    outcome = record.outcome
    if outcome is None:
        return f": {record.reason}"
    if outcome["kind"] == "fold":
        return f": {millimetres(outcome['displacement'], signed=True)}"
    return ""


def _result(record: Record) -> Result:
    """Result in a part's `record`, MissingPart where it could not be measured."""
    if record.outcome is None:
        return MissingPart(part=record.key, reason=record.reason)
    return _ANY.validate_python(record.outcome, strict=False)
