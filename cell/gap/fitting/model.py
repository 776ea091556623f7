"""A model under test: the base with some effects, and a point in its space of unknowns."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cell.gap.subject.subject import Candidate, Parameter, Request, Residuals, Run
from drivers.types import Array

LOST_RESIDUAL = 10.0  # whitened residual of a sample that the model cannot show; set by hand


@dataclass(frozen=True, slots=True)
class Model:
    """Base parameters and the effects that are switched on, in this order.

    With `held` the shared parameters have these values and only runs' own unknowns are free.
    """

    base: tuple[Parameter, ...]
    effects: tuple[Candidate, ...] = ()
    held: tuple[float, ...] | None = None

    @property
    def name(self) -> str:
        """Names of the effects, joined by ` + `, or `base` where there are none."""
        return " + ".join(e.name for e in self.effects) or "base"

    @property
    def names(self) -> frozenset[str]:
        """Names of the effects in the model."""
        return frozenset(e.name for e in self.effects)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Shared parameters: the base's, then each effect's."""
        if self.held is not None:
            return ()
        return self.base + tuple(p for e in self.effects for p in e.parameters)

    def holding(self, shared: Array) -> "Model":
        """The same model with its shared parameters held at these values (P,)."""
        return replace(self, held=tuple(map(float, shared)))

    def split(self, shared: Array) -> tuple[Array, dict[str, Array]]:
        """Split shared values (P,) into those of the base and those of each effect by name."""
        shared = shared if self.held is None else np.array(self.held)
        effects, at = {}, len(self.base)
        for effect in self.effects:
            effects[effect.name] = shared[at : at + len(effect.parameters)]
            at += len(effect.parameters)
        return shared[: len(self.base)], effects

    def join(self, base: Array, effects: dict[str, Array]) -> Array:
        """Join base values and values by effect to shared values (P,), missing effects at null."""
        parts = [e.complete(effects.get(e.name, e.null)) for e in self.effects]
        return np.concatenate([base, *parts])


@dataclass(frozen=True, slots=True)
class Point:
    """Values of the shared parameters (P,) and of each run's own unknowns."""

    shared: Array
    local: tuple[Array, ...]


@dataclass(frozen=True, slots=True)
class Evidence:
    """Runs to fit, and the scale (n,) that whitens the residuals of each."""

    runs: tuple[Run, ...]
    scales: tuple[Array, ...]

    def start(self) -> tuple[Array, ...]:
        """Start values (k,) of each run's own unknowns."""
        return tuple(np.array([p.start for p in run.local]) for run in self.runs)


def evidence(runs: Sequence[Run]) -> Evidence:
    """Evidence of `runs`, whitened by noise and floor."""
    scales = [np.hypot(run.samples.noise, run.samples.floor) for run in runs]
    return Evidence(tuple(runs), tuple(scales))


def unknowns(model: Model, evidence: Evidence) -> list[Parameter]:
    """All unknowns of a fit: shared parameters, then each run's own."""
    return [*model.parameters, *(p for run in evidence.runs for p in run.local)]


def request(model: Model, run: Run, shared: Array, local: Array) -> Request:
    """Request to simulate one run at shared values (P,) and its own unknowns (k,)."""
    base, effects = model.split(shared)
    return Request(run, base, effects, local)


def requests(model: Model, runs: Sequence[Run], point: Point) -> list[Request]:
    """Requests to simulate all runs at `point`."""
    return [request(model, r, point.shared, v) for r, v in zip(runs, point.local, strict=True)]


def whiten(residuals: Residuals, scale: Array) -> Array:
    """Residuals (n,) in units of `scale` (n,); lost samples count as LOST_RESIDUAL."""
    return np.nan_to_num(
        residuals.mean / scale, nan=LOST_RESIDUAL, posinf=LOST_RESIDUAL, neginf=-LOST_RESIDUAL
    )


def response(there: Residuals, here: Residuals, scale: Array) -> Array:
    """Change (n,) of residuals from `here` to `there`, in units of `scale` (n,)."""
    return whiten(there, scale) - whiten(here, scale)
