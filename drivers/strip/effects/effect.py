"""One physical or measuring phenomenon that a model may lack."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Literal

from drivers.errors import ConfigurationError
from drivers.strip.model import StripModel


class Stage(IntEnum):
    """Where in the description an effect acts; effects apply in this order."""

    LAW = 0
    BOUNDARY = 1
    OBSERVATION = 2


@dataclass(frozen=True, slots=True)
class Parameter:
    """A number of an effect: unit, the value that switches it off, and its physical range.

    `null` None means that absence switches it off. Only the first parameter of an effect is its
    switch; the others carry a `default` instead.
    """

    name: str
    unit: str
    low: float
    high: float
    null: float | None = 0.0
    default: float | None = None


@dataclass(frozen=True, slots=True)
class Effect:
    """A named phenomenon as a pure function from description to description.

    `sentence` is for a technician; `channels` are the measured channels in which it shows;
    `revealed_by` is the motion that shows it best.
    """

    name: str
    sentence: str
    of: Literal["strip", "cell"]
    stage: Stage
    parameters: tuple[Parameter, ...]
    apply: Callable[[StripModel, Mapping[str, float]], StripModel]
    channels: frozenset[str]
    revealed_by: str

    def complete(self, values: Mapping[str, float]) -> dict[str, float]:
        """`values` with the defaults of the parameters that were not given."""
        defaults = {p.name: p.default for p in self.parameters if p.default is not None}
        return {**defaults, **values}

    def applied(self, model: StripModel, values: Mapping[str, float]) -> StripModel:
        """`model` with this effect; at its null the very same object."""
        switch = self.parameters[0]
        complete = self.complete(values)
        if switch.name not in complete or complete[switch.name] == switch.null:
            return model
        return self.apply(model, complete)

    def check(self, values: Mapping[str, float], origin: str) -> None:
        """Raise ConfigurationError for unknown, missing or out-of-range parameters."""
        known = {p.name: p for p in self.parameters}
        for name in values:
            if name not in known:
                raise ConfigurationError(
                    f"{origin}.{name}: unknown parameter; allowed: {', '.join(known)}"
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
