"""An effect: one physical or measurement phenomenon that a model may lack."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Literal

import numpy as np

from drivers.errors import ConfigurationError, suggestion
from drivers.strip.file import StripFile
from drivers.strip.model import StripModel

Role = Literal["amount", "place", "width", "time", "ratio", "shape"]
UNKNOWN_SIZES = (0.01, 0.1)  # of its range, for an effect that states no typical sizes


class Stage(IntEnum):
    """Stage of the description at which an effect acts; effects apply in this order."""

    SIZE = 0
    LAW = 1
    BOUNDARY = 2
    OBSERVATION = 3


@dataclass(frozen=True, slots=True)
class Span:
    """Values from `low` to `high`, uniform or uniform in their logarithm; times the length."""

    low: float
    high: float
    log: bool = False
    of_length: bool = False

    def draw(self, rng: np.random.Generator, length: float) -> float:
        """Draw a value for a strip of `length` [m]."""
        if self.log:
            return float(np.exp(rng.uniform(np.log(self.low), np.log(self.high))))
        value = self.low if self.low == self.high else float(rng.uniform(self.low, self.high))
        return value * length if self.of_length else value


PLACE_SPAN = Span(0.15, 0.95, of_length=True)  # along a strip, away from its fixed end


@dataclass(frozen=True, slots=True)
class Parameter:
    """A number of an effect: unit, the value that switches it off, and its physical range.

    The first parameter of an effect is its switch, and those after it that have a null; one
    whose `null` is None is switched off by absence. Without a `default` it must be given.
    `role` says what the number means: how much, where along the strip, over which width, within
    which time, a ratio of stiffnesses, or a shape of the law. A shape parameter stays at its
    default until measurements of this effect ask for more; `guess` is the size of a first try.
    """

    name: str
    unit: str
    low: float
    high: float
    null: float | None = 0.0
    default: float | None = None
    role: Role = "amount"
    guess: float | None = None


@dataclass(frozen=True, slots=True)
class Effect:
    """A named phenomenon as a pure function from description to description.

    `sentence` is for a technician; `revealed_by` is the motion that shows it best; `typical`
    gives, for a strip, values of the switch from just visible in ten runs to as large as
    laboratories report, one of the other sign among them where the two sides act unlike;
    `textile` are the spans of its parameters over textiles, in the order in which to draw them;
    `looks_like` names effects that no run of a fold separates from this one.
    """

    name: str
    sentence: str
    of: Literal["strip", "cell"]
    stage: Stage
    parameters: tuple[Parameter, ...]
    apply: Callable[[StripModel, Mapping[str, float]], StripModel]
    revealed_by: str
    typical: Callable[[StripFile], tuple[float, ...]] | None = None
    textile: Mapping[str, Span] = field(default_factory=dict)
    looks_like: frozenset[str] = frozenset()

    def sizes(self, strip: StripFile) -> tuple[float, ...]:
        """Values of the switch to screen `strip` at, within the switch's range."""
        switch = self.parameters[0]
        span = UNKNOWN_SIZES if switch.null is not None else UNKNOWN_SIZES[::-1]
        given = (share * switch.high for share in span)
        found = self.typical(strip) if self.typical is not None else tuple(given)
        return tuple(float(np.clip(value, switch.low, switch.high)) for value in found)

    def complete(self, values: Mapping[str, float]) -> dict[str, float]:
        """`values` with the defaults of the parameters that were not given."""
        defaults = {p.name: p.default for p in self.parameters if p.default is not None}
        return {**defaults, **values}

    def apply_to(self, model: StripModel, values: Mapping[str, float]) -> StripModel:
        """`model` with this effect; the same object where the effect is at its null.

        Raises ConfigurationError for values that do not fit the strip.
        """
        complete = self.complete(values)
        if self.parameters[0].name not in complete or self._vanishes(complete):
            return model
        try:
            return self.apply(model, complete)
        except ConfigurationError as error:
            raise ConfigurationError(f"effects.{self.name}.{error}") from None

    def _vanishes(self, values: Mapping[str, float]) -> bool:
        nulls = {p.name: p.null for p in self.parameters if p.null is not None}
        return bool(nulls) and all(values.get(name, null) == null for name, null in nulls.items())

    def check(self, values: Mapping[str, float], origin: str) -> None:
        """Raise ConfigurationError for unknown, missing or out-of-range parameters."""
        known = {p.name: p for p in self.parameters}
        for name in values:
            if name not in known:
                raise ConfigurationError(
                    f"{origin}.{name}: unknown parameter{suggestion(name, known)}; "
                    f"allowed: {', '.join(known)}"
                )
        complete = self.complete(values)
        for name, parameter in known.items():
            if name not in complete:
                raise ConfigurationError(f"{origin}.{name}: is missing; add it")
            value = complete[name]
            if value != parameter.null and not parameter.low <= value <= parameter.high:
                raise ConfigurationError(
                    f"{origin}.{name}: {value:g} is out of range; "
                    f"allowed: {parameter.low:g} to {parameter.high:g} {parameter.unit}"
                )
