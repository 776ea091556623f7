"""Inputs of one simulation of a run: edits of the model, errors of readings, and the start."""

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cell.gap.subject.mechanism.effect import Effect, Fields, Readings
from cell.gap.subject.mechanism.runs import Cut
from drivers.types import Array

OPTION = "opt."  # prefix of the names of fields that are options of a model


@dataclass(frozen=True, slots=True)
class Content:
    """Content of a run for simulation: readings, stated `load`, given `motion` or `commands`."""

    cut: Cut
    load: Mapping[str, Any] | None = None
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


class ModelFields:
    """Fields of one model, edited in place; `finish` writes edited scalar options back."""

    def __init__(self, model: Any) -> None:
        self.model = model
        self._numbers: dict[str, Array] = {}

    def __getitem__(self, name: str) -> Array:
        """Array of the field called `name`, to be edited in place."""
        if not name.startswith(OPTION):
            found: Array = getattr(self.model, name)
            return found
        value = getattr(self.model.opt, name.removeprefix(OPTION))
        if isinstance(value, np.ndarray):
            return value
        return self._numbers.setdefault(name, np.array(float(value)))

    def finish(self) -> None:
        """Write edited scalar options into the model."""
        for name, value in self._numbers.items():
            setattr(self.model.opt, name.removeprefix(OPTION), float(value))


class BatchFields:
    """Fields of simulation `i` of a batch; the first edit of a field copies it per simulation."""

    def __init__(self, expand: Callable[[str], Array], i: int) -> None:
        self._expand, self._i = expand, i

    def __getitem__(self, name: str) -> Array:
        """Array of the field called `name` for this simulation."""
        found: Array = self._expand(name)[self._i, ...]
        return found
