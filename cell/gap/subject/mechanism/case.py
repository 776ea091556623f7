"""One simulation of a run: edited numbers of the model, readings, and the start."""

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cell.gap.subject.mechanism.effect import Effect, Fields, Readings
from cell.gap.subject.mechanism.runs import Cut
from drivers.types import Array


@dataclass(frozen=True, slots=True)
class Content:
    """Data of a run for its simulation: its readings, its stated `load`, and its `motion` or its
    `commands`.
    """

    cut: Cut
    load: Mapping[str, Any] | None = None
    motion: Any = None
    commands: Any = None
    start: tuple[Array, Array] | None = None


@dataclass(frozen=True, slots=True)
class Case:
    """A run with edited model: `edit` changes fields, `readings` lie between world and record,
    `paths` are torques of the motion so far; `start` are positions and rates. Cases of one `motion`
    move alike, and may be read otherwise.
    """

    content: Content
    edit: Callable[[Fields], None]
    readings: Readings
    paths: Sequence[tuple[Effect, Array]]
    start: tuple[Array, Array]
    motion: Hashable


class ModelFields:
    """Fields of one model, edited in place; numbers of its options are put back by `finish`."""

    def __init__(self, model: Any) -> None:
        self.model = model
        self._numbers: dict[str, Array] = {}

    def __getitem__(self, name: str) -> Array:
        """Array of the field called `name`, to be edited in place."""
        if not name.startswith("opt."):
            found: Array = getattr(self.model, name)
            return found
        value = getattr(self.model.opt, name[4:])
        if isinstance(value, np.ndarray):
            return value
        return self._numbers.setdefault(name, np.array(float(value)))

    def finish(self) -> None:
        """Put edited numbers of the options into the model."""
        for name, value in self._numbers.items():
            setattr(self.model.opt, name[4:], float(value))


class BatchFields:
    """Fields of simulation `i` of a batch; a field is expanded where it is first edited."""

    def __init__(self, expand: Callable[[str], Array], i: int) -> None:
        self._expand, self._i = expand, i

    def __getitem__(self, name: str) -> Array:
        """Array of the field called `name` for this simulation."""
        found: Array = self._expand(name)[self._i, ...]
        return found
