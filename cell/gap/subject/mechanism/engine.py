"""Engine of a mechanism: prepares its measured runs, and predicts what their sensors read."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cell.gap.subject.mechanism.effect import Effect, Readings
from cell.gap.subject.mechanism.fields import Fields
from cell.gap.subject.mechanism.load import MechanismData
from cell.gap.subject.mechanism.runs import Cut, Recording, average, cut, phases, samples, width_of
from cell.gap.subject.subject import Samples, Words
from cell.record.header import Load
from drivers.errors import ConfigurationError
from drivers.types import Array

BLOCK = 0.4  # rad of the fastest signal in one sample


@dataclass(frozen=True, slots=True)
class Content:
    """Content of a run for simulation: readings, stated `load`, given `motion` or `commands`.

    `start` are positions and rates (joints,) where the run states them.
    """

    cut: Cut
    load: Load | None = None
    motion: Any = None
    commands: Any = None
    start: tuple[Array, Array] | None = None


@dataclass(frozen=True, slots=True)
class Case:
    """One simulation of a run with an edited model.

    `edit` changes the model's fields, `readings` are errors of sensors and commands, `paths` hold
    effects whose torques depend on the motion so far, `start` positions and rates (joints,). Cases
    of equal `motion` move alike; their readings may differ.
    """

    content: Content
    edit: Callable[[Fields], None]
    readings: Readings
    paths: Sequence[tuple[Effect, Array]]
    start: tuple[Array, Array]
    motion: Hashable


class Engine(ABC):
    """Predicts the signals of an `opened` mechanism; `notes` are remarks on it for the operator."""

    notes: tuple[str, ...] = ()

    def __init__(self, opened: MechanismData) -> None:
        self._opened, self._mechanism = opened, opened.mechanism
        model = self._mechanism.model
        colliding = (model.geom_contype > 0) & (model.geom_conaffinity > 0)
        if not model.npair and len(set(model.geom_bodyid[colliding])) > 1:
            self.notes = (*self.notes, "contacts are off: the model lists no pair of geoms")
        left_out = next(iter(self.not_honoured()), None)
        if left_out is not None:
            raise ConfigurationError(
                f"{opened.path}: model: {left_out}: would be left out in mode {opened.file.mode}; "
                "take it out of the model, or compare in the other mode"
            )

    def not_honoured(self) -> Iterable[str]:
        """What the mode would leave out of signals, by name; nothing where the model is whole."""
        return ()

    def prepare(self, recording: Recording) -> tuple[Content, Samples]:
        """Content of a run for `predict`, and its samples with their phases."""
        signals, width = self._opened.signals, width_of(recording, BLOCK / self._opened.pace)
        made = cut(recording, [s.name for s in signals], width)
        content = self._content(recording, made, width)
        if recording.sigma is not None:
            signals = tuple(replace(s, sigma=recording.sigma) for s in signals)
        return content, samples(signals, content.cut, self._phases(content))

    @abstractmethod
    def predict(self, cases: Sequence[Case]) -> list[Array | None]:
        """Signals (signals, k) of each case at its readings; None where its simulation is lost."""

    @abstractmethod
    def _content(self, recording: Recording, made: Cut, width: float) -> Content:
        """Content of a run whose readings were cut into samples of `width` [s]."""

    def _phases(self, content: Content) -> Words:
        """Phase (b,) of each sample, by the speed of the first signal."""
        made = content.cut
        return phases(average(np.gradient(made.values[0], made.t)[None], made.edges)[0])
