"""Requests of folds, and the refusal of impossible requests before anything is
compiled.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np

from cell.base.config.cell import CellFile
from cell.base.config.length import metres
from cell.base.devices.devices import Trial
from cell.base.devices.open import check_calibrated, check_drivers
from cell.folding.bias import LIMIT
from cell.folding.correction import Correction, learned_correction, subject_of
from cell.folding.experience import Memory
from cell.record.files import Keep
from cell.record.film import Encoder
from cell.setup.arm.run_settings import at_speed, limit_to_arm, slow_down
from drivers.strip.describe import doubts
from drivers.strip.file import StripFile
from policies.experiments.standard import STANDARD, standard_order
from policies.registry import MOTION, make_policy

LEARNING_WORDS = ("auto", "on", "off")
UNCORRECTED = Correction()


@dataclass(frozen=True, slots=True)
class Recording:
    """Options of a fold's record beside its tables: images, film, truth, recording for
    Rerun.
    """

    frames: Keep | None = None
    film: Encoder | None = None
    truth: bool = True
    viz: Literal["save", "live", "off"] = "off"


@dataclass(frozen=True, slots=True)
class Learning:
    """Correction of a fold by the cell's learned bias; the cell `learns` from the fold
    or not.

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
    """Request of one fold: cell, strip, policy and options, as values that a process
    can be sent.

    `runs` is the folder for its record, `speed` [m/s] on the path replaces the cell's
    own, and a real robot is slowed down unless at `full_speed`.
    """

    cell: CellFile
    strip: StripFile
    policy: str
    runs: Path
    trial: Trial = field(default_factory=Trial)
    checkpoint: Path | None = None
    speed: float | None = None
    full_speed: bool = False
    record: Recording = Recording()
    learning: Learning = Learning()

    @property
    def settings(self) -> CellFile:
        """Settings of the cell for this fold, with its speed and the limits of its
        arm.
        """
        settings = at_speed(self.cell, self.speed)
        if settings.has_real_arm and not self.full_speed:
            settings = slow_down(settings)
        return limit_to_arm(settings)


def repetitions(
    base: Request, plants: Sequence[StripFile], repeat: int = 1
) -> tuple[Request, ...]:
    """Requests of a batch: `repeat` folds on each of `plants`; fold number i has seed S
    + i.
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
    """Requests of the standard runs, shuffled by `base`'s seed S; number i has seed S +
    i.
    """
    order = standard_order(np.random.default_rng(base.trial.seed))
    return tuple(
        replace(
            base,
            policy=MOTION + name,
            speed=STANDARD[name].speed,
            trial=replace(base.trial, index=i, seed=base.trial.seed + i),
        )
        for i, name in enumerate(order)
    )


def standard_run(request: Request) -> tuple[str, str]:
    """Name of the standard run that `request` carries out, and the effects that it
    reveals.
    """
    name = request.policy.removeprefix(MOTION)
    return name, STANDARD[name].reveals


@dataclass(frozen=True, slots=True)
class Prepared:
    """Requests of a batch of folds, checked and corrected, and the `doubts` about them.

    A doubt is a warning about a strip or plant outside the range for which an engine
    was validated.
    """

    requests: tuple[Request, ...]
    doubts: tuple[str, ...]


def prepare(
    base: Request, plants: Sequence[StripFile] = (), repeat: int = 1
) -> Prepared:
    """Prepare `repeat` folds on each of `plants` as `base` says, whoever asks for them.

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
    """Copy of `request` with the correction of its aim that the option `learning` asks
    for.

    `learning` is as `Learning.use`. Raises ConfigurationError for other text.
    """
    memory = memory_of(request)
    learns = False
    correction = UNCORRECTED
    if learning is not None and learning not in LEARNING_WORDS:
        correction = Correction(metres("--learning", learning, LIMIT))
    elif _should_learn(request, learning, memory):
        specimen = request.learning.specimen
        subject = subject_of(
            request.policy, request.checkpoint, request.strip.name, specimen
        )
        learns = True
        correction = learned_correction(memory, subject)
    changed = replace(request.learning, correction=correction, learns=learns)
    return replace(request, learning=changed)


def memory_of(request: Request) -> Memory:
    """Memory of learned biases that a fold uses and updates: of the cell, or of its
    twin.
    """
    return Memory(
        request.cell.name, request.learning.memory, twin=not request.cell.is_physical
    )


def _should_learn(request: Request, learning: str | None, memory: Memory) -> bool:
    """Whether the fold is corrected and learned from, by option, memory and
    settings.
    """
    use = request.cell.learning.use
    if learning in {"on", "off"}:
        return learning == "on"
    if memory.is_off or use == "off":
        return False
    return (use == "on" and learning != "auto") or request.cell.is_physical
