"""Requests of folds, and the refusal of impossible requests before anything is
compiled.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from cell.base.config.cell import CellFile
from cell.base.config.length import metres
from cell.base.devices.devices import Trial
from cell.base.devices.open import check_calibrated, check_drivers
from cell.folding.bias import LIMIT
from cell.folding.correction import (
    BiasKey,
    Correction,
    learned_correction,
    subject_of,
)
from cell.folding.experience import Memory
from cell.record.files import Keep
from cell.record.film import Encoder
from cell.setup.arm.run_settings import at_speed, limit_to_arm, slow_down
from drivers.base.errors import ConfigurationError, in_mm
from drivers.strip.describe import doubts
from drivers.strip.file import StripFile
from policies.experiments.standard import STANDARD, standard_order
from policies.path import FoldLine
from policies.registry import MOTION, make_policy

LEARNING_WORDS = ("auto", "on", "off")
LINES = (0.15, 0.5)  # of the length, from the grasped edge, where a strip is folded
UNCORRECTED = Correction()


@dataclass(frozen=True, slots=True)
class RecordingOptions:
    """What is recorded of a fold besides its tables: camera images, a film, the true
    motion of a simulated strip, and a live view.
    """

    frames: Keep | None = None
    film: Encoder | None = None
    truth: bool = True
    live: bool = False


@dataclass(frozen=True, slots=True)
class Learning:
    """How a fold is corrected by what its cell has learned from earlier ones, and
    whether the cell `learns` from this fold too.

    `specimen` names the piece of fabric; `memory` is a folder instead of the user's.
    `use` is what was asked for: `auto`, `on`, `off`, a length to correct by without
    learning, or None for the cell's own setting. `prepare` makes the rest of it.
    """

    specimen: str | None = None
    memory: Path | None = None
    use: str | None = None
    correction: Correction = UNCORRECTED
    learns: bool = False


@dataclass(frozen=True, slots=True)
class Request:
    """Request of one fold: the cell, the strip, the policy and options, all as values
    that can be sent to another process.

    `runs` is the folder for its record, `speed` [m/s] on the path replaces the cell's
    own, and a real robot is slowed down unless at `full_speed`. The strip is folded
    `at` [m] from its grasped edge, in half where that is None.
    """

    cell: CellFile
    strip: StripFile
    policy: str
    runs: Path
    trial: Trial = field(default_factory=Trial)
    checkpoint: Path | None = None
    speed: float | None = None
    full_speed: bool = False
    record: RecordingOptions = RecordingOptions()
    learning: Learning = Learning()
    at: float | None = None

    @property
    def line(self) -> FoldLine:
        """Line across the strip along which it is folded."""
        return FoldLine.of(self.strip.length, self.at)

    @property
    def condition(self) -> str:
        """Text that is equal for folds that are made alike: the policy, the speed and,
        unless it is the middle, where the strip is folded.
        """
        label = f"{self.policy} at {self.settings.fold.speed:g} m/s"
        if self.line.is_half:
            return label
        return f"{label}, folded {in_mm(self.line.at)} from the grasped edge"

    @property
    def subject(self) -> BiasKey:
        """What the bias that the cell learns from this fold belongs to: policy, strip
        and specimen, and the fold line unless it is the middle.
        """
        specimen = self.learning.specimen
        mine = subject_of(self.policy, self.checkpoint, self.strip.name, specimen)
        if self.line.is_half:
            return mine
        return replace(mine, policy=f"{mine.policy} at {self.line.at:.3f} m")

    @property
    def settings(self) -> CellFile:
        """Settings of the cell for this fold, with the requested speed, and with the
        limits of the cell's arm.
        """
        settings = at_speed(self.cell, self.speed)
        if settings.has_real_arm and not self.full_speed:
            settings = slow_down(settings)
        return limit_to_arm(settings)


def repetitions(
    base: Request, plants: Sequence[StripFile], repeat: int = 1
) -> tuple[Request, ...]:
    """Requests of a batch like `base`: `repeat` folds on each of the simulated strips
    `plants`, each with a random seed of its own.
    """
    on_desk: Sequence[StripFile | None] = plants or [None]
    folds = [(plant, index) for plant in on_desk for index in range(repeat)]
    first_seed = base.trial.seed
    trials = [
        replace(base.trial, plant=plant, index=index, seed=first_seed + number)
        for number, (plant, index) in enumerate(folds)
    ]
    return tuple(replace(base, trial=trial) for trial in trials)


def standard_requests(base: Request) -> tuple[Request, ...]:
    """Requests of the standard runs for a fit, like `base` but each with a standard
    motion, in an order drawn at random by the seed of `base`.
    """
    seed = base.trial.seed
    order = standard_order(np.random.default_rng(seed))
    return tuple(
        replace(
            base,
            policy=MOTION + name,
            speed=STANDARD[name].speed,
            trial=replace(base.trial, index=i, seed=seed + i),
        )
        for i, name in enumerate(order)
    )


def standard_run(request: Request) -> tuple[str, str]:
    """Name of the standard motion that `request` carries out, and the effects that it
    shows.
    """
    name = request.policy.removeprefix(MOTION)
    return name, STANDARD[name].reveals


@dataclass(frozen=True, slots=True)
class Prepared:
    """Requests of a batch of folds, checked and with their corrections, and warnings
    about them in `doubts`.

    A doubt is a warning about a strip or plant outside the range for which an engine
    was validated.
    """

    requests: tuple[Request, ...]
    doubts: tuple[str, ...]


def prepare(
    base: Request, plants: Sequence[StripFile] = (), repeat: int = 1
) -> Prepared:
    """Check and correct a batch of `repeat` folds, like `base`, on each of the
    simulated strips `plants`.

    Raises ConfigurationError for devices, calibration, policy or learning that cannot
    be used.
    """
    check_drivers(base.cell)
    check_calibrated(base.cell)
    make_policy(base.policy, base.checkpoint)
    corrected = with_correction(base, base.learning.use)
    strips = (base.strip, *plants)
    said = dict.fromkeys(doubt for strip in strips for doubt in doubts(strip))
    return Prepared(repetitions(corrected, plants, repeat), tuple(said))


def with_correction(request: Request, learning: str | None) -> Request:
    """Copy of `request` with the correction of its aim that the text `learning` asks
    for; None leaves this to the cell's settings.

    `learning` is as `Learning.use`. Raises ConfigurationError for other text.
    """
    memory = memory_of(request)
    learns = False
    correction = UNCORRECTED
    if learning is not None and learning not in LEARNING_WORDS:
        correction = Correction(metres("--learning", learning, LIMIT))
    elif _should_learn(request, learning, memory):
        learns = True
        correction = learned_correction(memory, request.subject)
    changed = replace(request.learning, correction=correction, learns=learns)
    return replace(request, learning=changed)


def line_at(option: str, texts: Sequence[str], length: float) -> float | None:
    """Distance [m] from the grasped edge of a strip of `length` [m] to the line along
    which it is folded; None for a fold in half.

    Each of `texts` is a share of the length, as 1/3 or 0.4, or a length, as 200mm; None
    without any, for a fold in half. Raises ConfigurationError for other text, a line
    that is not folded, and more than one.
    """
    if not texts:
        return None
    if len(texts) > 1:
        raise ConfigurationError(
            f"{option}: is given {len(texts)} times, one line a fold is allowed: a"
            " second fold carries two layers, which no model of this cell describes;"
            " fold once, and lay the strip again"
        )

    share = re.fullmatch(r"\s*([\d.]+)\s*(?:/\s*([\d.]+)\s*)?", texts[0])
    try:
        at = length * float(share[1]) / float(share[2] or 1) if share else None
    except (ValueError, ZeroDivisionError):
        at = None

    at = metres(option, texts[0]) if at is None else at
    low, high = (allowed * length for allowed in LINES)
    if not low <= at <= high:
        raise ConfigurationError(
            f"{option}: {texts[0]} is {in_mm(at)} from the grasped edge, allowed"
            f" {1e3 * low:.0f} to {in_mm(high)}, {LINES[0]:g} to {LINES[1]:g} of"
            " the strip's length: beyond the middle the grasped part is the longer one"
        )

    return at


def memory_of(request: Request) -> Memory:
    """Memory of what a cell has learned that the fold of `request` uses: that of the
    real cell or, in simulation, one of its own.
    """
    return Memory(
        request.cell.name, request.learning.memory, twin=not request.cell.is_physical
    )


def _should_learn(request: Request, learning: str | None, memory: Memory) -> bool:
    """Whether the fold of `request` is corrected and learned from, by the option
    `learning`, the state of the `memory` and the cell's settings.
    """
    use = request.cell.learning.use
    if learning in {"on", "off"}:
        return learning == "on"
    if memory.is_off or use == "off":
        return False
    return (use == "on" and learning != "auto") or request.cell.is_physical
