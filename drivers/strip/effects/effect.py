"""Effects: physical or measurement phenomena that a strip's model may lack."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from functools import partial
from math import inf, sqrt
from typing import Literal

import numpy as np

from drivers.base.errors import ConfigurationError, suggestion
from drivers.strip.file import StripFile
from drivers.strip.model import StripModel, with_field

Apply = Callable[[StripModel, Mapping[str, float]], StripModel]
Role = Literal["amount", "place", "width", "time", "ratio", "shape"]
ASSUMED_SIZES = (0.01, 0.1)  # of its range, for an effect that states no typical sizes
# of the smallest size of an amount or of a shape's guess: step of finite differences
SECANT = 0.1
FARTHEST = 3.0  # times the largest size or a shape's guess: prior spread
# of a width's or time's start: its step and prior spread
SCALE_STEP, SCALE_SPREAD = 0.02, 4.0


class Stage(IntEnum):
    """Part of the strip model that an effect changes; effects apply in the order of
    these stages.
    """

    SIZE = 0
    LAW = 1
    BOUNDARY = 2
    OBSERVATION = 3


@dataclass(frozen=True, slots=True)
class Span:
    """Distribution from which a parameter is drawn: uniform from `low` to `high`, or
    log-uniform if `log`.

    Both are shares of the strip's length if `of_length`.
    """

    low: float
    high: float
    log: bool = False
    of_length: bool = False

    def sample(self, rng: np.random.Generator, length: float) -> float:
        """Value drawn at random from the distribution, for a strip of `length` [m]."""
        lowest = self.low
        if self.log:
            value = float(np.exp(rng.uniform(np.log(lowest), np.log(self.high))))
        else:
            value = (
                lowest if lowest == self.high else float(rng.uniform(lowest, self.high))
            )
        return value * length if self.of_length else value


PLACE_SPAN = Span(0.15, 0.95, of_length=True)  # along a strip, away from its fixed end


@dataclass(frozen=True, slots=True)
class Parameter:
    """Description of one number of an effect, a strip model or a run: its unit, range,
    prior and finite-difference step.

    `start` is the stated value, of an effect's amount the null at which the effect
    vanishes.
    `spread` is the standard deviation of what was known before (infinite: nothing).
    `inverse` parameters are reciprocals of what files state, so that a null at infinity
    is a zero here.
    `role` says what the number means: an amount, a place along the strip, a width, a
    time, a ratio of stiffnesses, or a shape of the law. All but amounts say where or
    how an effect acts, not how strongly: a probe keeps them whatever its amount. Ratios
    and shapes are `start` where a file does not state them; a shape stays there until
    measurements of its effect require more. An effect with half of its shapes below
    `own_from` has a law like another's, and is not named.
    `random` unknowns of a run are drawn anew in each run; their `spread` is estimated
    from the runs; `common` ones are expected to differ in any laboratory. `tolerated`
    is the range that the file states for a value of the base; None where it states a
    `spread` alone.
    """

    name: str
    unit: str
    start: float = 0.0
    low: float = -inf
    high: float = inf
    step: float = 0.0
    spread: float = inf
    inverse: bool = False
    role: Role = "amount"
    own_from: float = -inf
    random: bool = False
    common: bool = False
    tolerated: tuple[float, float] | None = None

    @classmethod
    def signed(cls, name: str, unit: str, most: float) -> "Parameter":
        """Parameter for an effect's amount that may have either sign, up to `most` in
        size.
        """
        return cls(name, unit, low=-most, high=most)

    @classmethod
    def limit(cls, name: str, unit: str, low: float, high: float) -> "Parameter":
        """Parameter for a limiting force or stiffness from `low` to `high`; at infinity
        the effect is absent.
        """
        return cls(
            name=name,
            unit=unit,
            start=0.0,
            low=1.0 / high,
            high=1.0 / low,
            inverse=True,
        )

    @classmethod
    def scale(
        cls, name: str, unit: str, low: float, high: float, role: Role
    ) -> "Parameter":
        """Parameter for a width or time of an effect, of which only the range from
        `low` to `high` is known.
        """
        start = sqrt(low * high)
        return cls(
            name=name,
            unit=unit,
            start=start,
            low=low,
            high=high,
            step=SCALE_STEP * start,
            spread=SCALE_SPREAD * start,
            role=role,
        )

    @classmethod
    def shape(cls, name: str, unit: str, high: float, guess: float) -> "Parameter":
        """Parameter for the shape of an effect's law, from 0 (usual) to `high`; a fit
        first tries `guess`.
        """
        return cls(
            name=name,
            unit=unit,
            start=0.0,
            low=0.0,
            high=high,
            step=SECANT * guess,
            spread=FARTHEST * guess,
            role="shape",
        )

    @property
    def is_amount(self) -> bool:
        """Whether the parameter says how strongly its effect acts."""
        return self.role == "amount"

    @property
    def stated_range(self) -> tuple[float, float]:
        """Least and greatest value of the parameter as strip files state it."""
        low, high = sorted(map(self.stated_value, (self.low, self.high)))
        return low, high

    def stated_value(self, value: float) -> float:
        """Convert a fitted `value` to the one that strip files state, or back: the
        reciprocal for `inverse` parameters.
        """
        if not self.inverse:
            return value
        return 1.0 / value if value else inf


# where something lies along a strip, and how far it reaches there
POSITION = Parameter("position", "m", low=0.0, high=2.0, role="place")
WIDTH = Parameter.scale("width", "m", low=0.001, high=0.5, role="width")


def set_fields(**fields: str) -> Apply:
    """Build the `apply` function of an effect that writes its parameters into a model's
    fields, given as dotted paths.
    """

    def apply(model: StripModel, values: Mapping[str, float]) -> StripModel:
        for name, path in fields.items():
            model = with_field(model, path, values[name])
        return model

    return apply


@dataclass(frozen=True, slots=True)
class Effect:
    """Physical or measurement phenomenon, as a pure function from strip model to strip
    model.

    `sentence` describes it to a technician; `revealed_by` is the motion that shows it
    best; `typical` gives, for a strip, values of the first parameter, from just visible
    in ten runs to as large as laboratories report, with one of opposite sign where the
    signs act differently; `textile` are the spans of its parameters over textiles, in
    the order in which to draw them; `looks_like` names effects that folds cannot
    distinguish from this one.
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
        """Typical values of the effect's first parameter for `strip`, the weakest
        effect first.

        They are clipped to its range; where none are stated, ASSUMED_SIZES of its upper
        end.
        """
        first = self.parameters[0]
        low, high = first.stated_range
        if self.typical is not None:
            typical = self.typical(strip)
        else:
            typical = tuple(fraction * high for fraction in ASSUMED_SIZES)
            if first.inverse:  # a limit, such as a friction: the smaller, the stronger
                typical = typical[::-1]
        return tuple(float(np.clip(size, low, high)) for size in typical)

    def complete(self, values: Mapping[str, float]) -> dict[str, float]:
        """Copy of the effect's parameter `values`, with default ratios and shapes where
        they are missing.
        """
        usual = {
            p.name: p.start for p in self.parameters if p.role in {"ratio", "shape"}
        }
        return {**usual, **values}

    def stated(self, values: Sequence[float]) -> dict[str, float] | None:
        """Fitted `values` of the effect by parameter name, as strip files state them;
        None where the effect is absent.

        They may lack those of the shape, which come last.
        """
        first = self.parameters[0]
        if first.inverse and values[0] <= first.low:
            return None
        pairs = zip(self.parameters, map(float, values), strict=False)
        return {p.name: p.stated_value(value) for p, value in pairs}

    def apply_to(self, model: StripModel, values: Mapping[str, float]) -> StripModel:
        """Copy of `model` with this effect applied; `model` itself where the effect is
        at null.

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
        amounts = [p for p in self.parameters if p.is_amount and p.name in values]
        return all(p.stated_value(values[p.name]) == p.start for p in amounts)

    def check(self, values: Mapping[str, float], origin: str) -> None:
        """Raise ConfigurationError for unknown, missing or out-of-range parameter
        `values`.
        """
        check_values(self.complete(values), self.parameters, (), origin)


def check_values(
    values: Mapping[str, float],
    needed: Sequence[Parameter],
    optional: Sequence[Parameter],
    origin: str,
) -> None:
    """Raise ConfigurationError for unknown, missing or out-of-range `values` of
    parameters.
    """
    known = {p.name: p for p in (*needed, *optional)}
    for name in values:
        if name not in known:
            raise ConfigurationError(
                f"{origin}.{name}: unknown parameter{suggestion(name, known)}; "
                f"allowed: {', '.join(known)}"
            )
    for parameter in needed:
        if parameter.name not in values:
            raise ConfigurationError(f"{origin}.{parameter.name}: is missing; add it")
    for name, value in values.items():
        low, high = known[name].stated_range
        if not low <= value <= high:
            raise ConfigurationError(
                f"{origin}.{name}: {value:g} is out of range; "
                f"allowed: {low:g} to {high:g} {known[name].unit}"
            )


law_effect = partial(Effect, of="strip", stage=Stage.LAW)
