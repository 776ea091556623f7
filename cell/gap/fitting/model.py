"""Models under test, a base with some effects, and values of their unknowns."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from cell.gap.subject.subject import (
    Candidate,
    FitRun,
    Residuals,
    SimulationRequest,
    starts,
)
from drivers.base.types import Array
from drivers.strip.effects.effect import Parameter

# whitened residual of a sample that the model cannot show; set by hand
LOST_RESIDUAL = 10.0


@dataclass(frozen=True, slots=True)
class Model:
    """Model to fit: its base parameters, and the effects that are added to it.

    With `held` the shared parameters have these values and only runs' own unknowns are
    free.
    """

    base: tuple[Parameter, ...]
    effects: tuple[Candidate, ...] = ()
    held: tuple[float, ...] | None = None

    @property
    def name(self) -> str:
        """Names of the model's effects, joined by ` + `, or `base` where it has
        none.
        """
        return " + ".join(effect.name for effect in self.effects) or "base"

    @property
    def names(self) -> frozenset[str]:
        """Names of the model's effects, as a set."""
        return frozenset(effect.name for effect in self.effects)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Parameters that all runs share: of the base, then of each effect; none if
        fixed.
        """
        if self.held is not None:
            return ()
        return self.base + tuple(
            p for effect in self.effects for p in effect.parameters
        )

    def holding(self, shared: Array) -> "Model":
        """Copy of the model whose shared parameters are fixed at the values `shared`
        (P,).
        """
        return replace(self, held=tuple(map(float, shared)))

    def split(self, shared: Array) -> tuple[Array, dict[str, Array]]:
        """Split shared values (P,) into those of the base, and those of each effect by
        its name.
        """
        shared = shared if self.held is None else np.array(self.held)
        sizes = [len(self.base), *(len(effect.parameters) for effect in self.effects)]
        base, *parts = np.split(shared, np.cumsum(sizes)[:-1])
        names = (effect.name for effect in self.effects)
        return base, dict(zip(names, parts, strict=True))

    def join(self, base: Array, effects: dict[str, Array]) -> Array:
        """Shared values (P,) from those of the `base` and of the `effects` by name;
        missing effects are at null.
        """
        parts = [
            effect.complete(effects.get(effect.name, effect.null))
            for effect in self.effects
        ]
        return np.concatenate([base, *parts])


class Point(NamedTuple):
    """Values of all unknowns of a fit: `shared` (P,) parameters, and `local` ones (k,)
    by run.
    """

    shared: Array
    local: Sequence[Array]


def stated(runs: Sequence[FitRun], shared: Array) -> Point:
    """Values to start a fit from: `shared` (P,) ones, and the start values of each
    run's own unknowns.
    """
    return Point(shared, [starts(run.local) for run in runs])


def request(
    model: Model, run: FitRun, shared: Array, local: Array
) -> SimulationRequest:
    """Request to simulate `run` with `model`, at `shared` values (P,) and the run's own
    values `local` (k,).
    """
    base, effects = model.split(shared)
    return SimulationRequest(run, base, effects, local)


def requests(
    model: Model, runs: Sequence[FitRun], point: Point
) -> list[SimulationRequest]:
    """Requests to simulate each of `runs` by `model` at the values `point`."""
    return [
        request(model, run, point.shared, v)
        for run, v in zip(runs, point.local, strict=True)
    ]


def whiten(residuals: Residuals, scale: Array) -> Array:
    """Residuals (n,) divided by `scale` (n,); those that are not finite become
    LOST_RESIDUAL.
    """
    return np.nan_to_num(
        residuals.mean / scale,
        nan=LOST_RESIDUAL,
        posinf=LOST_RESIDUAL,
        neginf=-LOST_RESIDUAL,
    )


def response(moved: Residuals, start: Residuals, scale: Array) -> Array:
    """Change (n,) of whitened residuals from a simulation `start` to `moved`; `scale`
    (n,) is the noise.
    """
    return whiten(moved, scale) - whiten(start, scale)
