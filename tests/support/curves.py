"""Subject of analytical curves, to test the gap engine without strips or mechanisms."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from cell.gap.fitting import CountedSimulation, run_one
from cell.gap.fitting.crossvalidation import CrossValidatedFit, validate
from cell.gap.fitting.gauss_newton import FitEstimate, refit
from cell.gap.fitting.model import Model, stated
from cell.gap.investigate import investigate
from cell.gap.selection.hold_out import held_out
from cell.gap.subject.subject import (
    Candidate,
    Experiment,
    FitRun,
    Quantity,
    Residuals,
    Samples,
    Scope,
    Series,
    SimulationRequest,
    Subject,
    starts,
)
from cell.gap.verdict.compose import verdict as compose
from cell.gap.verdict.findings import Findings
from cell.gap.verdict.schema import Verdict
from drivers.base.types import Array
from drivers.strip.effects.effect import Parameter

T = np.linspace(0.0, 1.0, 60)
SPEEDS = {"slow": 0.5, "medium": 1.0, "fast": 2.0, "faster": 3.0}
Law = Callable[[Array, float, int], Array]


def bump(t: Array, speed: float, _: int) -> Array:
    return speed * np.exp(-(((t - 0.5) / 0.12) ** 2))


def wave(t: Array, speed: float, _: int) -> Array:
    return np.sin(9.0 * t) / speed


def nothing(t: Array, _: float, __: int) -> Array:
    return np.zeros_like(t)


LAWS: Mapping[str, Law] = {"bump": bump, "twin": bump, "wave": wave, "dead": nothing}


def candidate(name: str, signed: bool) -> Candidate:
    p = Parameter("size", "m", 0.0, -5.0 if signed else 0.0, 5.0, 1e-3, 1.0)
    return Candidate(name, f"there is a {name}", "strip", (p,), (((0.01,),), ((0.1,),)))


@dataclass
class Curves(Subject):
    """Subject y = offset + slope t + effects + a shift of each run; `truth` is
    hidden.
    """

    truth: Law
    names: Sequence[str] = ("bump", "wave", "dead")
    noise: float = 0.01
    seed: int = 0
    repeats: int = 2
    scatter: float = 0.0
    signed: bool = True
    name: str = "curves"
    notes: Sequence[str] = ()
    runs: list[FitRun] = field(default_factory=list)

    def __post_init__(self) -> None:
        rng = np.random.default_rng(self.seed)
        for index, condition in enumerate([*SPEEDS] * self.repeats):
            y = (
                0.2
                + 0.5 * T
                + 0.03 * rng.standard_normal()
                + self.noise * rng.standard_normal(60)
            )
            y = y + self.scatter * rng.standard_normal() * T**2
            self.runs.append(
                self.run(index, condition, y + self.truth(T, SPEEDS[condition], index))
            )

    def run(self, index: int, condition: str, y: Array) -> FitRun:
        phase = np.where(T < 0.5, "lift", "fall")
        of = Series("angle", "angle", phase, "middle", T, self.noise, self.noise, 0.0)
        samples = Samples.stack([of])
        shift = Parameter("shift", "m", 0.0, -np.inf, np.inf, 1e-4, 0.1)
        return FitRun(f"r{index}", condition, samples, (shift,), (condition, y), index)

    @property
    def scope(self) -> Scope:
        base = (
            Parameter("offset", "m", 0.0, -10.0, 10.0, 1e-4, 1.0),
            Parameter("slope", "m/s", 0.0, -10.0, 10.0, 1e-4, 1.0),
        )
        quantity = Quantity("angle_mrad", 1e3, "mrad")
        return Scope(
            base,
            tuple(candidate(name, self.signed) for name in self.names),
            {"angle": quantity},
        )

    def simulate(self, requests: Sequence[SimulationRequest]) -> list[Residuals]:
        found = []
        for q in requests:
            condition, y = q.run.content
            simulated = q.base[0] + q.base[1] * T + q.local[0]
            for name, values in q.effects.items():
                simulated = simulated + self.added(name, values, SPEEDS[condition])
            found.append(Residuals(y - simulated, (y - simulated) ** 2))
        return found

    def added(self, name: str, values: Array, speed: float) -> Array:
        """Change (60,) [m] of a curve by the effect `name` with its `values`."""
        return values[0] * LAWS[name](T, speed, 0)

    def experiments(self) -> Sequence[Experiment]:
        run = self.run(99, "faster", np.zeros(60))
        return [Experiment("fast", "make it fast", time, run) for time in (9.0, 1.0)]

    def patch(
        self,
        base: Mapping[str, float],
        effects: Mapping[str, Mapping[str, float]],
        source: str,
    ) -> tuple[dict[str, object], None]:
        return {"base": dict(base), "effects": dict(effects), "source": source}, None


class Touched(Curves):
    """Curves whose last sample is a touch, a channel of its own."""

    @property
    def scope(self) -> Scope:
        whole = super().scope
        return replace(
            whole,
            quantities=dict.fromkeys(("angle", "touch"), whole.quantities["angle"]),
        )

    def run(self, index: int, condition: str, y: Array) -> FitRun:
        words = np.array(["angle"] * 59 + ["touch"])
        run = super().run(index, condition, y)
        return replace(run, samples=replace(run.samples, channel=words, quantity=words))


def judged(subject: Curves) -> tuple[Findings, Verdict]:
    simulate = CountedSimulation(subject.simulate)
    held = held_out(subject, simulate)
    found = investigate(subject, held, simulate, lambda stage, share: None)
    return found, compose(found, 0.0, simulate.total)


def fitted(subject: Curves, names: Sequence[str] = ()) -> FitEstimate:
    scope, runs = subject.scope, subject.runs
    model = Model(scope.base, tuple(c for c in scope.candidates if c.name in names))
    start = stated(runs, starts(model.parameters))
    return run_one(subject.simulate, refit(model, runs, start))


def hidden(law: Law, size: float) -> Law:
    return lambda t, speed, index: size * law(t, speed, index)


def both(bumps: float, waves: float) -> Law:
    """Law of a bump and a wave, of these sizes."""
    return lambda t, s, i: bumps * bump(t, s, i) + waves * wave(t, s, i)


def validated(
    estimate: FitEstimate, subject: Curves | None = None
) -> CrossValidatedFit:
    simulate = (subject or Curves(nothing)).simulate
    return run_one(simulate, validate(estimate))
