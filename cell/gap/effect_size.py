"""Effect sizes: how large a hidden effect must be to leave a given residual after a
refit.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple, Self

import numpy as np

from cell.gap.diagnosis import held_out_gap
from cell.gap.fitting import run_one
from cell.gap.fitting.base_fit import projection, stated_estimate
from cell.gap.fitting.gauss_newton import responses_to
from cell.gap.subject.strip.measurement_errors import SLACK_EFFECTS
from cell.gap.subject.strip.runs import MeasuredRun
from cell.gap.subject.strip.subject import StripSubject
from cell.gap.subject.strip.synthetic import measured_along
from cell.gap.subject.subject import NamedValues
from cell.record.header import Sigma
from drivers.base.errors import ConfigurationError
from drivers.base.types import Array
from drivers.strip.effects import registry
from drivers.strip.effects.effect import Effect
from drivers.strip.file import StripFile
from drivers.strip.rod.engine import GripperPath

# shares of the way from null to the largest believable
LADDER = np.geomspace(1e-2, 1.0, 12)
ROUNDS = 3  # of the search for a share: the ladder, then finer ones between its steps
STEPS = 6  # of a finer ladder
BELIEVABLE = 3.0  # times the largest size that laboratories report
PLACE_RANGE = (0.3, 0.95)  # of the length, where an effect of one place may sit
WIDTHS = (1.0, 4.0)  # bending lengths, of an effect that has a width
TIME_RANGE = (0.1, 2.0)  # s, of one that has a time
RATIOS = (5.0, 12.0)  # of pre-sliding over bending stiffness


class Strengths(NamedTuple):
    """Range of strengths of an effect: its first parameter runs from null to `largest`,
    its `others` are fixed.
    """

    effect: Effect
    others: dict[str, float]
    largest: float

    def at(self, fraction: float) -> dict[str, float]:
        """Parameter values by name at a `fraction`, in (0, 1], of the largest size."""
        p = self.effect.parameters[0]
        largest = self.largest
        start = p.start
        if p.inverse:
            value = largest / fraction
        elif start > 0.0:
            value = start * (largest / start) ** fraction
        else:
            value = fraction * largest
        return {p.name: float(np.clip(value, *p.stated_range)), **self.others}


def draw_strengths(
    effect: Effect, strip: StripFile, rng: np.random.Generator
) -> Strengths:
    """Draw sign and shape parameters (place, width, time, ratio) of an effect at
    random.

    Its sizes go up to the largest believable on `strip`.
    """
    others = _draw_shape(effect, strip, rng)
    sign = 1.0 if rng.uniform() < 0.5 else -1.0  # where the effect has both
    p = effect.parameters[0]
    sizes = effect.sizes(strip)
    if p.inverse:
        largest = max(p.stated_range[0], min(sizes) / BELIEVABLE)
    elif p.start > 0.0:
        largest = max(sizes) ** sign
    else:
        side = 1.0 if p.low >= 0.0 else sign
        largest = np.clip(BELIEVABLE * max(map(abs, sizes)) * side, p.low, p.high)

    return Strengths(effect, others, largest)


def _draw_shape(
    effect: Effect, strip: StripFile, rng: np.random.Generator
) -> dict[str, float]:
    """Draw place [m], width [m], time [s], ratio of an effect; further amounts are at
    null.
    """
    uniform = rng.uniform
    others = {}
    for p in effect.parameters[1:]:
        match p.role:
            case "place":
                value = strip.length * uniform(*PLACE_RANGE)
            case "width":
                value = strip.bending_length * uniform(*WIDTHS)
            case "time":
                value = float(np.exp(uniform(*np.log(TIME_RANGE))))
            case "ratio":
                value = uniform(*RATIOS)
            case "amount":
                value = p.start
            case _:
                continue
        others[p.name] = value
    return others


def indistinguishable_from(name: str) -> frozenset[str]:
    """Names of the effects that change every fold as `name` does; none for unknown
    names.
    """
    return registry()[name].looks_like if name in registry() else frozenset()


class GapModel:
    """Predicts the excess residual that hidden effects leave on simulated runs of a
    strip after the base is refitted.

    The runs `made` are of the strip `plant`; the residual is in units of noise, after a
    refit.
    """

    def __init__(self, plant: StripFile, made: Sequence[MeasuredRun]) -> None:
        runs = [
            replace(run, name=f"{i:02d}-{run.name}", index=i)
            for i, run in enumerate(made)
        ]
        self._subject = StripSubject(plant, runs, scatter=SLACK_EFFECTS)
        self._estimate = stated_estimate(self._subject, self._subject.simulate)
        self._about = projection(self._estimate)

    @classmethod
    def along(
        cls, plant: StripFile, paths: Sequence[GripperPath], sigma: Sigma
    ) -> Self:
        """Gap model of `plant`, simulated along the gripper `paths` and measured with
        the noise `sigma`.
        """
        by_name = {f"path-{i}": path for i, path in enumerate(paths)}
        return cls(plant, measured_along(by_name, plant, sigma, index=0))

    def excess(self, hidden: Sequence[NamedValues]) -> Array:
        """Excess residuals (k,) [noise] that k sets of hidden effects leave after a
        refit.
        """
        return np.array(
            [self.excess_of(response) for response in self.responses(hidden)]
        )

    def responses(self, hidden: Sequence[NamedValues]) -> list[Array]:
        """Changes (N,) [noise] of residuals that each set of effects leaves after a
        refit.
        """
        estimate = self._estimate
        base = estimate.shared
        library = self._subject.scope.by_name
        models = [(estimate.model, base)]
        for effects in hidden:
            members = [library[name].with_shape() for name in effects]
            model = replace(estimate.model, effects=tuple(members))
            values = [_engine_values(*each) for each in effects.items()]
            models.append((model, np.concatenate([base, *values])))

        found = run_one(self._subject.simulate, responses_to(estimate, models))
        return [self._about.unabsorbed(np.concatenate(by_run)) for by_run in found]

    def excess_of(self, response: Array) -> float:
        """Excess residual [noise] of runs that differ from their model by a `response`
        (N,).
        """
        estimate = self._estimate
        noisy = [
            np.hypot(r, run.samples.noise / run.samples.scale)
            for r, run in zip(estimate.by_run(response), estimate.runs, strict=True)
        ]
        return held_out_gap.excess_of(replace(estimate, residuals=noisy))

    def fraction(
        self, strengths: Strengths, target: float, most: float = np.inf
    ) -> float | None:
        """Smallest fraction of the `strengths` of an effect that leaves an excess
        residual of `target` [noise], found on a grid.

        None where no share does, or where the gap jumps past `most`, as that of a slip
        may.
        """
        if strengths.effect.name not in self._subject.scope.by_name:
            return None  # the rod cannot simulate it on this strip
        shares = LADDER
        try:
            if self._excess_along(strengths, LADDER[-1:]).max() < target:
                return None
            for _ in range(ROUNDS):
                excess = self._excess_along(strengths, shares)
                k = min(np.flatnonzero(excess >= target), default=len(shares) - 1)
                smallest = shares[k]
                gap = excess[k]
                shares = np.geomspace(shares[max(k - 1, 0)], smallest, STEPS)
        except ConfigurationError:
            return None
        return smallest if gap <= most else None

    def _excess_along(self, strengths: Strengths, shares: Array) -> Array:
        return self.excess(
            [{strengths.effect.name: strengths.at(share)} for share in shares]
        )


def _engine_values(name: str, values: Mapping[str, float]) -> Array:
    """Parameters (p,) of the effect `name` in the engine's units, from a strip file's
    `values`.
    """
    effect = registry()[name]
    complete = effect.complete(values)
    shapes_last = sorted(effect.parameters, key=lambda p: p.role == "shape")
    return np.array([p.stated_value(complete[p.name]) for p in shapes_last])
