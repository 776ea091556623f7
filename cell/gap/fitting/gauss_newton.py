"""Robust Gauss-Newton fit of a model to runs, with Jacobians by finite differences.

Shared parameters and each run's own unknowns are estimated jointly. Simulations are
expensive and responses nearly linear, so that a Jacobian is kept while it predicts the
decrease well. The error of a simulation must be small beside what one finite-difference
step changes: a secant across a jump is no slope, and counts as information that is
none.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from cell.gap.fitting import Task, robust, side_by_side
from cell.gap.fitting.model import (
    Model,
    Point,
    request,
    requests,
    response,
    whiten,
)
from cell.gap.fitting.normal_equations import NormalEquations, Unknowns
from cell.gap.subject.subject import (
    Candidate,
    FitRun,
    Residuals,
    SimulationRequest,
    starts,
)
from drivers.base.types import Array
from drivers.strip.effects.effect import Parameter

JacobianUse = Literal["new", "kept", "mended"]
Linearised = tuple[Sequence[Residuals], Sequence[Array]]
T = TypeVar("T")
# nats that a further step must promise: in the end, to compare; set by hand, small
# beside MIN_GAIN
FINAL_GAIN, ROUGH_GAIN = 0.05, 2.0


def linearise(model: Model, runs: Sequence[FitRun], point: Point) -> Task[Linearised]:
    """Residuals and whitened Jacobian (samples, unknowns) of each run at `point`; a
    task that yields simulation requests.
    """
    pairs = zip(runs, point.local, strict=True)
    shared = point.shared
    tasks = [_linearise_run(model, run, shared, local) for run, local in pairs]
    by_run = yield from side_by_side(tasks)
    return [raw for raw, _ in by_run], [jacobian for _, jacobian in by_run]


def _linearise_run(
    model: Model, run: FitRun, shared: Array, local: Array
) -> Task[tuple[Residuals, Array]]:
    """Residuals and whitened Jacobian (samples, unknowns) of one run; a task that
    yields simulation requests.
    """
    batch, steps = _secant_requests(model, run, shared, local)
    answers = yield batch
    at_point, *stepped = answers[1:] if run.replicate else answers
    scale = run.samples.scale
    return answers[0], _secant_jacobian(at_point, stepped, scale, steps)


def _secant_jacobian(
    at_point: Residuals, stepped: Sequence[Residuals], scale: Array, steps: Array
) -> Array:
    """Whitened Jacobian (n, k) by finite differences over `steps` (k,) in k unknowns; 0
    where residuals are NaN.

    It is that of residuals `at_point`, from those `stepped` in each of k unknowns;
    `scale` (n,) is the noise.
    """
    columns = [
        (m.mean - at_point.mean) / scale / h
        for m, h in zip(stepped, steps, strict=True)
    ]
    matrix = np.array(columns).reshape(len(columns), len(scale)).T
    return np.where(np.isfinite(matrix), matrix, 0.0)


def _secant_requests(
    model: Model, run: FitRun, shared: Array, local: Array
) -> tuple[list[SimulationRequest], Array]:
    """Simulation requests at the given values and one step off in each of k unknowns,
    and the steps (k,).

    For a replicate the first, at the values, comes once more as a response to compare
    with.
    """
    unknowns = zip((*model.parameters, *run.local), (*shared, *local), strict=True)
    steps = np.array([_step_within_bounds(p, value) for p, value in unknowns])
    point = np.concatenate([shared, local])
    batch = [
        request(model, run, *np.split(z, [len(shared)]))
        for z in (point, *(point + np.diag(steps)))
    ]
    if not run.replicate:
        return batch, steps
    responses = [replace(each, response=True) for each in batch]
    return [batch[0], *responses], steps


def _step_within_bounds(p: Parameter, value: float) -> float:
    """Finite-difference step of the parameter `p` at `value`, reversed where its bound
    forbids it.
    """
    return p.step if p.low <= value + p.step <= p.high else -p.step


MOST_STEPS = 20  # of a fit
# Shares of the decrease that a step predicted, set by hand. In TRUSTED a Jacobian is
# kept; in MENDABLE Broyden's update corrects it, once.
TRUSTED, MENDABLE = (0.7, 1.4), (0.3, 2.5)
# shares of a step too long that are tried; set by hand
PARABOLA = (1.0, 0.5, 0.25, 0.1, 0.02)
DAMPING = 1e-3  # of the bend of that parabola, relative to the curvature; set by hand


@dataclass(frozen=True, slots=True)
class FitEstimate:
    """Values of all unknowns of a model, with its residuals and Jacobians there.

    Per run: `residuals` (n,) whitened, `raw` in physical units, `jacobians` (n, shared
    + local) of the whitened residuals. `scale` is their dispersion.
    """

    model: Model
    runs: Sequence[FitRun]
    point: Point
    residuals: Sequence[Array]
    raw: Sequence[Residuals]
    jacobians: Sequence[Array]
    scale: float

    @classmethod
    def at(
        cls,
        model: Model,
        runs: Sequence[FitRun],
        point: Point,
        raw: Sequence[Residuals],
        jacobians: Sequence[Array],
    ) -> Self:
        """Estimate at the values `point`, from each run's simulated residuals `raw` and
        whitened Jacobian (samples, unknowns).
        """
        r = residuals(raw, runs)
        scale = robust.scale(np.concatenate(r))
        return cls(
            model=model,
            runs=runs,
            point=point,
            residuals=r,
            raw=raw,
            jacobians=jacobians,
            scale=scale,
        )

    @property
    def shared(self) -> Array:
        """Values (P,) of the parameters that all runs share: of the base, then of the
        effects.
        """
        return self.point.shared

    @property
    def local(self) -> Sequence[Array]:
        """Values (k,) of the own unknowns of each run."""
        return self.point.local

    @property
    def effects(self) -> tuple[Candidate, ...]:
        """Effects that the fitted model adds to its base."""
        return self.model.effects

    @property
    def names(self) -> frozenset[str]:
        """Names of the model's effects, as a set."""
        return self.model.names

    @property
    def name(self) -> str:
        """Names of the model's effects in one text."""
        return self.model.name

    @property
    def values(self) -> tuple[Array, dict[str, Array]]:
        """Values (b,) of the base, and those (k,) of each effect by its name."""
        return self.model.split(self.shared)

    @property
    def proxies(self) -> list[Candidate]:
        """Effects of the model whose fitted law is not their own: they stand in for one
        that the library lacks.
        """
        _, values = self.values
        return [
            effect for effect in self.effects if not effect.is_own(values[effect.name])
        ]

    @property
    def unknowns(self) -> Unknowns:
        """Parameters of all unknowns in one vector, with their bounds and priors."""
        return Unknowns.of(self.model, self.runs)

    @property
    def z(self) -> Array:
        """Values (size,) of all unknowns in one vector: the shared ones, then those of
        each run.
        """
        return np.concatenate([self.shared, *self.local])

    @property
    def stacked_residuals(self) -> Array:
        """Whitened residuals (N,) of all runs, run by run."""
        return np.concatenate(self.residuals)

    @property
    def stacked_jacobian(self) -> Array:
        """Whitened Jacobian (N, size) of all runs in all unknowns."""
        unknowns = self.unknowns
        count = sum(map(len, self.residuals))
        rows = self.by_run(np.arange(count))
        full = np.zeros((count, len(unknowns.low)))
        for i, jacobian in enumerate(self.jacobians):
            full[np.ix_(rows[i], unknowns.columns(i))] = jacobian
        return full

    @property
    def changes(self) -> Array:
        """Whitened changes (P, samples) of the residuals that each shared value causes
        by its distance from its start.
        """
        moved = self.shared - starts(self.model.parameters)
        return np.transpose(self.stacked_jacobian[:, : len(moved)] * moved)

    def by_run(self, stacked: NDArray[Any]) -> list[NDArray[Any]]:
        """Split an array `stacked` (N, ...) of all samples into the rows (n, ...) of
        each run.
        """
        return np.split(stacked, np.cumsum([len(r) for r in self.residuals])[:-1])

    @property
    def objective(self) -> float:
        """Robust loss [nats] of the fit: of its residuals at their own dispersion, plus
        that of the priors.
        """
        return self.objective_at(self.scale)

    def objective_at(self, scale: float) -> float:
        """Robust loss of the residuals at the dispersion `scale` plus that of the
        priors [nats].
        """
        unknowns = self.unknowns
        data: float = sum(robust.loss(r / scale).sum() for r in self.residuals)
        return data + 0.5 * float(unknowns.precision @ (self.z - unknowns.mean) ** 2)

    def normal(self) -> NormalEquations:
        """Robustly weighted normal equations of the fit's data and priors, at the
        dispersion of its residuals.
        """
        unknowns = self.unknowns
        s = self.scale
        prior = unknowns.precision
        gradient = prior * (self.z - unknowns.mean)
        curvature = np.diag(prior)

        runs = zip(self.residuals, self.jacobians, strict=True)
        for i, (r, jacobian) in enumerate(runs):
            weighted = jacobian.T * (robust.weights(r / s) / s**2)
            columns = unknowns.columns(i)
            gradient[columns] += weighted @ r
            curvature[np.ix_(columns, columns)] += weighted @ jacobian

        return NormalEquations(gradient, curvature)

    def on(self, indices: Sequence[int]) -> "FitEstimate":
        """Copy of the estimate restricted to the runs with the numbers `indices`."""

        def pick(by_run: Sequence[T]) -> list[T]:
            return [by_run[index] for index in indices]

        return FitEstimate(
            model=self.model,
            runs=pick(self.runs),
            point=Point(self.shared, pick(self.local)),
            residuals=pick(self.residuals),
            raw=pick(self.raw),
            jacobians=pick(self.jacobians),
            scale=self.scale,
        )


def responses_to(
    at: FitEstimate, models: Sequence[tuple[Model, Array]]
) -> Task[list[Sequence[Array]]]:
    """Change (samples,) of each run's whitened residuals from the first of `models` to
    each other one.

    Each model comes with its shared values (P,); the unknowns of the runs are those of
    the fit `at`. A task that yields requests.
    """
    runs = at.runs
    scales = [run.samples.scale for run in runs]
    answers = yield [
        replace(request(model, run, shared, unknowns), response=True)
        for model, shared in models
        for run, unknowns in zip(runs, at.local, strict=True)
    ]
    first, *others = _portions(answers, len(runs))
    return [tuple(map(response, other, first, scales)) for other in others]


def best(estimates: Sequence[FitEstimate]) -> FitEstimate:
    """Estimate with the smallest objective, all compared at the smallest of their
    dispersions.
    """
    scale = min(estimate.scale for estimate in estimates)
    return min(estimates, key=lambda e: e.objective_at(scale))


def refit(
    model: Model,
    runs: Sequence[FitRun],
    start: Point,
    jacobians: Sequence[Array] | None = None,
    enough: float = FINAL_GAIN,
    steps: int = MOST_STEPS,
) -> Task[FitEstimate]:
    """Fit `model` to `runs` from the values `start`; a task that yields simulation
    requests.

    `jacobians` (n, shared + local) by run of a fit nearby spare the first secants; the
    fit ends when a further step promises less than `enough` nats, or gains less with a
    new Jacobian, or after so many `steps`.
    """
    unknowns = Unknowns.of(model, runs)
    point = unknowns.point(np.concatenate([start.shared, *start.local]))
    use: JacobianUse = "new" if jacobians is None else "kept"
    fit = yield from _estimate_at(model, runs, point, jacobians)

    for _ in range(steps):
        equations = fit.normal()
        step = equations.bounded_step(unknowns.low - fit.z, unknowns.high - fit.z)
        promised = equations.decrease(step)
        if promised < enough:
            break

        trial = yield from _line_search(fit, equations.curvature, step)
        gain = fit.objective - trial.objective_at(fit.scale)
        ended = use == "new" and gain < enough
        use = _next_use(gain / promised, use)
        if use == "mended":
            trial = replace(
                trial, jacobians=_broyden_update(fit, trial, equations.curvature)
            )

        fit = trial if gain > 0.0 else replace(fit, jacobians=trial.jacobians)
        if ended:
            break

        if use == "new":
            fit = yield from _estimate_at(model, runs, fit.point)
    return fit


def _estimate_at(
    model: Model,
    runs: Sequence[FitRun],
    point: Point,
    jacobians: Sequence[Array] | None = None,
) -> Task[FitEstimate]:
    """Estimate of a model at the values `point`, with the given Jacobians or new ones;
    a task that yields simulation requests.
    """
    if jacobians is None:
        raw, jacobians = yield from linearise(model, runs, point)
    else:
        raw = yield requests(model, runs, point)
    return FitEstimate.at(model, runs, point, raw, jacobians)


def _next_use(fraction: float, use: JacobianUse) -> JacobianUse:
    """Whether to keep, correct or renew the Jacobian by the `fraction` of a predicted
    gain that was achieved.

    Of a Jacobian in `use` that was mended already, a further correction is not tried.
    """
    low, high = TRUSTED
    if low < fraction < high:
        return "kept"
    low, high = MENDABLE
    return "mended" if use != "mended" and low < fraction < high else "new"


def residuals(raw: Sequence[Residuals], runs: Sequence[FitRun]) -> Sequence[Array]:
    """Residuals (n,) of each of `runs`, whitened by the scales of its samples."""
    return [whiten(r, run.samples.scale) for r, run in zip(raw, runs, strict=True)]


def _line_search(fit: FitEstimate, curvature: Array, step: Array) -> Task[FitEstimate]:
    """Estimate after a full Gauss-Newton step or, where that gains nothing, the best
    one along a parabola.
    """
    full = (yield from _evaluate(fit, [fit.z + step]))[0]
    if full.objective_at(fit.scale) < fit.objective:
        return full
    bend = _second_order_step(fit, full, curvature, step)
    points = [fit.z + f * step + f * f * bend for f in PARABOLA]
    trials = yield from _evaluate(fit, [*points, fit.z + PARABOLA[-1] * step])
    return min(trials, key=lambda trial: trial.objective_at(fit.scale))


def _second_order_step(
    fit: FitEstimate, full: FitEstimate, curvature: Array, step: Array
) -> Array:
    """Second-order part (size,) of a fit's path to its minimum (geodesic acceleration,
    Transtrum 2012).

    What the residuals did beyond the linear promise in the `full` step is answered by
    the same linear model; weak directions, along which that was too bold, are damped.
    """
    unknowns = fit.unknowns
    gradient = np.zeros_like(step)
    rows = zip(fit.residuals, full.residuals, fit.jacobians, strict=True)
    for i, (before, after, jacobian) in enumerate(rows):
        columns = unknowns.columns(i)
        beyond = after - before - jacobian @ step[columns]
        gradient[columns] += jacobian.T @ beyond / fit.scale**2
    damped = curvature + DAMPING * np.diag(np.diag(curvature))
    equations = NormalEquations(gradient, damped)
    return equations.bounded_step(unknowns.low - full.z, unknowns.high - full.z)


def _broyden_update(
    fit: FitEstimate, trial: FitEstimate, curvature: Array
) -> Sequence[Array]:
    """Jacobian (samples, unknowns) of each run after the step from `fit` to `trial`, by
    Broyden's update (1965).

    They give the change of the residuals that was seen, at least change in units of
    what each unknown does; samples that either side lost change nothing.
    """
    unknowns = fit.unknowns
    change = trial.z - fit.z
    units = np.diag(curvature)

    updated = []
    rows = zip(fit.raw, trial.raw, fit.runs, fit.jacobians, strict=True)
    for i, (a, b, run, jacobian) in enumerate(rows):
        columns = unknowns.columns(i)
        step = change[columns]
        along = units[columns] * step
        beyond = np.nan_to_num((b.mean - a.mean) / run.samples.scale - jacobian @ step)
        length = max(float(along @ step), np.finfo(float).tiny)
        updated.append(jacobian + np.outer(beyond, along) / length)

    return updated


def _evaluate(fit: FitEstimate, points: Sequence[Array]) -> Task[list[FitEstimate]]:
    """Estimates at `points` (size,) clipped to their bounds, with the Jacobians of
    `fit`; a task that yields simulation requests.
    """
    runs = fit.runs
    inside = [*map(fit.unknowns.point, points)]
    answers = yield [q for p in inside for q in requests(fit.model, runs, p)]
    pairs = zip(inside, _portions(answers, len(runs)), strict=True)
    return [FitEstimate.at(fit.model, runs, p, raw, fit.jacobians) for p, raw in pairs]


def _portions(answers: Sequence[T], size: int) -> list[Sequence[T]]:
    """Split `answers` into portions of length `size`, which divides their number."""
    return [answers[k : k + size] for k in range(0, len(answers), size)]
