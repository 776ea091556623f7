"""Effects: physical or measurement phenomena that a strip's model may lack."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from functools import partial
from typing import Literal

import numpy as np

from drivers.errors import ConfigurationError, suggestion
from drivers.strip.file import StripFile
from drivers.strip.model import StripModel, with_field

Apply = Callable[[StripModel, Mapping[str, float]], StripModel]
Role = Literal["amount", "place", "width", "time", "ratio", "shape"]
ASSUMED_SIZES = (0.01, 0.1)  # of its range, for an effect that states no typical sizes


class Stage(IntEnum):
    """Part of the strip model that an effect changes; effects apply in this order."""

    SIZE = 0
    LAW = 1
    BOUNDARY = 2
    OBSERVATION = 3


@dataclass(frozen=True, slots=True)
class Span:
    """Uniform distribution, log-uniform if `log`, from `low` to `high`.

    Both are shares of the strip's length if `of_length`.
    """

    low: float
    high: float
    log: bool = False
    of_length: bool = False

    def sample(self, rng: np.random.Generator, length: float) -> float:
        """Random value of the distribution, for a strip of `length` [m]."""
        if self.log:
            value = float(np.exp(rng.uniform(np.log(self.low), np.log(self.high))))
        else:
            value = self.low if self.low == self.high else float(rng.uniform(self.low, self.high))
        return value * length if self.of_length else value


PLACE_SPAN = Span(0.15, 0.95, of_length=True)  # along a strip, away from its fixed end


@dataclass(frozen=True, slots=True)
class Parameter:
    """Parameter of an effect: its unit, its range, and the `null` value that switches it off.

    The first parameter of an effect switches it, as do later ones that have a null; one whose
    `null` is None is switched off by absence. Without a `default` it is required. `role` says what
    the number means: an amount, a place along the strip, a width, a time, a ratio of stiffnesses,
    or a shape of the law. A shape parameter stays at its default until measurements of this effect
    require more; `guess` is a first value to try.
    """

    name: str
    unit: str
    low: float
    high: float
    null: float | None = 0.0
    default: float | None = None
    role: Role = "amount"
    guess: float | None = None

    @classmethod
    def shape(cls, name: str, unit: str, high: float, guess: float) -> "Parameter":
        """Shape parameter of an effect's law, from 0, its default, to `high`."""
        return cls(name, unit, 0.0, high, null=None, default=0.0, role="shape", guess=guess)


def set_fields(**fields: str) -> Apply:
    """Function `apply` of an effect that writes parameters into model fields at dotted paths."""

    def apply(model: StripModel, values: Mapping[str, float]) -> StripModel:
        for name, path in fields.items():
            model = with_field(model, path, values[name])
        return model

    return apply


@dataclass(frozen=True, slots=True)
class Effect:
    """Physical or measurement phenomenon, as a pure function from strip model to strip model.

    `sentence` describes it to a technician; `revealed_by` is the motion that shows it best;
    `typical` gives, for a strip, values of the first parameter, from just visible in ten runs to as
    large as laboratories report, with one of opposite sign where the signs act differently;
    `textile` are the spans of its parameters over textiles, in the order in which to draw them;
    `looks_like` names effects that folds cannot distinguish from this one.
    """

    name: str
    sentence: str
    of: Literal["strip", "cell"]
    stage: Stage
    parameters: tuple[Parameter, ...]
    apply: Apply
    revealed_by: str
    typical: Callable[[StripFile], tuple[float, ...]] | None = None
    textile: Mapping[str, Span] = field(default_factory=dict)
    looks_like: frozenset[str] = frozenset()

    def sizes(self, strip: StripFile) -> tuple[float, ...]:
        """Typical values of the effect's first parameter for `strip`, the weakest effect first.

        They are clipped to its range; where none are stated, ASSUMED_SIZES of its upper end.
        """
        first = self.parameters[0]
        if self.typical is not None:
            typical = self.typical(strip)
        else:
            typical = tuple(share * first.high for share in ASSUMED_SIZES)
            if first.null is None:  # a limit, such as a friction: the smaller, the stronger
                typical = typical[::-1]
        return tuple(float(np.clip(size, first.low, first.high)) for size in typical)

    def complete(self, values: Mapping[str, float]) -> dict[str, float]:
        """Copy of `values` with the defaults of all parameters that it lacks."""
        defaults = {p.name: p.default for p in self.parameters if p.default is not None}
        return {**defaults, **values}

    def apply_to(self, model: StripModel, values: Mapping[str, float]) -> StripModel:
        """Copy of `model` with this effect applied; `model` itself where the effect is at null.

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
        """Raise ConfigurationError for unknown, missing or out-of-range parameter `values`."""
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


law_effect = partial(Effect, of="strip", stage=Stage.LAW)
