"""Robust Gauss-Newton fit of a model to runs, with Jacobians by secants.

Shared parameters and each run's own unknowns are estimated jointly. Simulations are expensive and
responses nearly linear, so that a Jacobian is kept while it predicts the decrease well. Close to a
bifurcation a small step makes samples jump, and a one-sided secant across the jump is no slope: it
would stop the fit and make its intervals too narrow. So the final fit uses two-sided slopes.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self, TypeVar

import numpy as np

from cell.gap.fitting import normal_equations, robust
from cell.gap.fitting.model import Evidence, Model, Point, request, requests, response, whiten
from cell.gap.fitting.tasks import Task, side_by_side
from cell.gap.subject.subject import Parameter, Request, Residuals, Run
from drivers.types import Array

Linearised = tuple[Sequence[Residuals], tuple[Array, ...]]
T = TypeVar("T")
# nats that a further step must promise: in the end, to compare; set by hand, small beside MIN_GAIN
FINAL_GAIN, ROUGH_GAIN = 0.05, 2.0


def linearise(model: Model, evidence: Evidence, point: Point) -> Task[Linearised]:
    """Residuals and whitened secants (n, shared + local) of each run; yields simulations."""
    batch: list[Request] = []
    steps: list[Array] = []
    for run, local in zip(evidence.runs, point.local, strict=True):
        run_requests, run_steps = _secant_requests(model, run, point.shared, local)
        batch += run_requests
        steps.append(run_steps)
    answers = yield batch
    raw, jacobians, offset = [], [], 0
    for run, run_steps, scale in zip(evidence.runs, steps, evidence.scales, strict=True):
        run_answers = answers[offset : offset + 1 + run.replicate + len(run_steps)]
        offset += len(run_answers)
        raw.append(run_answers[0])
        at_point, *stepped = run_answers[run.replicate :]
        jacobians.append(secants(at_point, stepped, scale, run_steps))
    return raw, tuple(jacobians)


def linearise_both_ways(model: Model, evidence: Evidence, point: Point) -> Task[Linearised]:
    """Residuals and whitened slopes (n, shared + local) of each run, by secants to both sides."""
    raw, right, left = yield from both_sides(model, evidence, point)
    return raw, tuple(map(minmod, right, left))


def both_sides(
    model: Model, evidence: Evidence, point: Point
) -> Task[tuple[Sequence[Residuals], tuple[Array, ...], tuple[Array, ...]]]:
    """Residuals, and whitened secants (n, shared + local) of each run to either side of a point.

    Where a bound forbids one side, both are secants to the other.
    """
    effects = [replace(e, parameters=_mirror(e.parameters)) for e in model.effects]
    other = replace(model, base=_mirror(model.base), effects=tuple(effects))
    runs = [replace(run, local=_mirror(run.local)) for run in evidence.runs]
    mirrored = replace(evidence, runs=tuple(runs))
    sides = [linearise(model, evidence, point), linearise(other, mirrored, point)]
    (raw, right), (_, left) = yield from side_by_side(sides)
    return raw, right, left


def minmod(a: Array, b: Array) -> Array:
    """The smaller of two slopes (n, k) where their signs agree, zero elsewhere."""
    # slope limiter: Roe 1986, Annual Review of Fluid Mechanics 18, 337
    return np.asarray(0.5 * (np.sign(a) + np.sign(b)) * np.minimum(np.abs(a), np.abs(b)))


def _mirror(parameters: Sequence[Parameter]) -> tuple[Parameter, ...]:
    return tuple(replace(p, step=-p.step) for p in parameters)


def secants(at_point: Residuals, stepped: Sequence[Residuals], scale: Array, steps: Array) -> Array:
    """Whitened finite differences (n, len(steps)), zero where a residual is lost."""
    columns = [(m.mean - at_point.mean) / scale / h for m, h in zip(stepped, steps, strict=True)]
    matrix = np.array(columns).reshape(len(columns), len(scale)).T
    return np.asarray(np.nan_to_num(matrix, nan=0.0, posinf=0.0, neginf=0.0))


def _secant_requests(
    model: Model, run: Run, shared: Array, local: Array
) -> tuple[list[Request], Array]:
    """Requests at the values and one step of each unknown away, and the steps (k,).

    For a replicate the first, at the values, comes once more as a response to compare with.
    """
    at_point = request(model, run, shared, local)
    batch, steps = [at_point] if run.replicate else [], []
    points = [(shared, local)]
    for i, p in enumerate(model.parameters):
        step = _step_within_bounds(p, shared[i])
        points.append((_step_one(shared, i, step), local))
        steps.append(step)
    for i, p in enumerate(run.local):
        step = _step_within_bounds(p, local[i])
        points.append((shared, _step_one(local, i, step)))
        steps.append(step)
    batch += [replace(request(model, run, *point), response=run.replicate) for point in points]
    return batch, np.array(steps)


def _step_within_bounds(p: Parameter, value: float) -> float:
    return p.step if p.low <= value + p.step <= p.high else -p.step


def _step_one(values: Array, i: int, h: float) -> Array:
    moved = values.copy()
    moved[i] += h
    return moved


MOST_STEPS = 20  # of a fit
# Shares of the decrease that a step predicted, set by hand. In TRUSTED a Jacobian is kept; in
# MENDABLE Broyden's update corrects it, once. Less than STALLED with fresh Jacobians, twice, ends
# the fit: the objective is not smooth.
TRUSTED, MENDABLE, STALLED = (0.7, 1.4), (0.3, 2.5), 0.1
PARABOLA = (1.0, 0.5, 0.25, 0.1, 0.02)  # shares of a step too long that are tried; set by hand
DAMPING = 1e-3  # of the bend of that parabola, relative to the curvature; set by hand


@dataclass(frozen=True, slots=True)
class Estimate:
    """A model at a point: its residuals and Jacobians there.

    Per run: `residuals` (n,) whitened, `raw` in physical units, `jacobians` (n, shared + local)
    of the whitened residuals. `scale` is the dispersion, `objective` the loss at it [nats].
    """

    model: Model
    evidence: Evidence
    point: Point
    residuals: tuple[Array, ...]
    raw: tuple[Residuals, ...]
    jacobians: tuple[Array, ...]
    scale: float
    objective: float

    @classmethod
    def at(
        cls,
        model: Model,
        evidence: Evidence,
        point: Point,
        raw: Sequence[Residuals],
        jacobians: tuple[Array, ...],
    ) -> Self:
        """Estimate at `point` from residuals `raw` and whitened `jacobians` (n, size) by run."""
        r = residuals(raw, evidence)
        scale = robust.scale(np.concatenate(r))
        found = cls(model, evidence, point, r, tuple(raw), jacobians, scale, 0.0)
        return replace(found, objective=found.objective_at(scale))

    @property
    def shared(self) -> Array:
        """Values of the shared parameters (P,)."""
        return self.point.shared

    @property
    def place(self) -> normal_equations.Layout:
        """Layout of all unknowns in one vector."""
        return normal_equations.layout(self.model, self.evidence)

    @property
    def z(self) -> Array:
        """Values of all unknowns (size,)."""
        return self.place.pack(self.point)

    @property
    def limits(self) -> normal_equations.Bounds:
        """Bounds and priors of all unknowns."""
        return normal_equations.bounds(self.model, self.evidence)

    def objective_at(self, scale: float) -> float:
        """Robust loss of the residuals at the dispersion `scale` plus that of the priors [nats]."""
        return normal_equations.objective(self.residuals, self.z, self.limits, scale)

    def normal(self, scale: float | None = None) -> normal_equations.Normal:
        """Normal equations of data and priors at dispersion `scale` (default: its own)."""
        dispersion = self.scale if scale is None else scale
        return normal_equations.normal(
            self.place, self.limits, self.z, self.residuals, self.jacobians, dispersion
        )

    def on(self, indices: Sequence[int]) -> Self:
        """The same estimate, restricted to the runs with the numbers `indices`."""

        def pick(by_run: Sequence[T]) -> tuple[T, ...]:
            return tuple(by_run[i] for i in indices)

        return replace(
            self,
            evidence=Evidence(pick(self.evidence.runs), pick(self.evidence.scales)),
            point=Point(self.shared, pick(self.point.local)),
            residuals=pick(self.residuals),
            raw=pick(self.raw),
            jacobians=pick(self.jacobians),
        )


def responses_to(
    at: Estimate, models: Sequence[tuple[Model, Array]]
) -> Task[list[tuple[Array, ...]]]:
    """Whitened changes (n,) of each run from the first of `models` to each other.

    Each model comes with its shared values (P,); the runs' own unknowns are those of the fit `at`.
    Yields simulations.
    """
    runs, scales = at.evidence.runs, at.evidence.scales
    answers = yield [
        replace(request(model, run, shared, unknowns), response=True)
        for model, shared in models
        for run, unknowns in zip(runs, at.point.local, strict=True)
    ]
    first, *others = (answers[k : k + len(runs)] for k in range(0, len(answers), len(runs)))
    return [tuple(map(response, other, first, scales)) for other in others]


def best(estimates: Sequence[Estimate]) -> Estimate:
    """Estimate with the smallest objective, compared at the smallest of the dispersions."""
    scale = min(e.scale for e in estimates)
    return min(estimates, key=lambda e: e.objective_at(scale))


def refit(
    model: Model,
    evidence: Evidence,
    start: Point,
    jacobians: tuple[Array, ...] | None = None,
    enough: float = FINAL_GAIN,
    steps: int = MOST_STEPS,
    *,
    both_ways: bool = False,
) -> Task[Estimate]:
    """Fit `model` to `evidence` from `start`; yields simulations.

    `jacobians` (n, shared + local) by run of a fit nearby spare the first secants; the fit ends
    when a further step promises less than `enough` nats, or after so many `steps`. With `both_ways`
    slopes are limited by secants to both sides, for twice the simulations.
    """
    slopes = linearise_both_ways if both_ways else linearise
    place = normal_equations.layout(model, evidence)
    limits = normal_equations.bounds(model, evidence)
    point = place.unpack(np.clip(place.pack(start), limits.low, limits.high))
    fresh, mended, stalled = jacobians is None, False, 0
    if jacobians is None:
        raw, jacobians = yield from slopes(model, evidence, point)
    else:
        raw = yield requests(model, evidence.runs, point)
    fit = Estimate.at(model, evidence, point, raw, jacobians)
    for _ in range(steps):
        equations = fit.normal()
        step = normal_equations.bounded_step(equations, fit.z, limits)
        promised = normal_equations.decrease(equations, step)
        if promised < enough:
            break
        trial = yield from _line_search(fit, equations.curvature, step)
        gain = fit.objective - trial.objective_at(fit.scale)
        share = gain / promised
        if gain <= 0.0 and fresh:
            break
        stalled = stalled + 1 if fresh and share < STALLED else 0
        trusted = TRUSTED[0] < share < TRUSTED[1]
        mended = not trusted and not mended and MENDABLE[0] < share < MENDABLE[1]
        fresh = not trusted and not mended
        jacobians = _broyden_update(fit, trial, equations.curvature) if mended else fit.jacobians
        fit = replace(trial if gain > 0.0 else fit, jacobians=jacobians)
        if stalled > 1:
            break
        if fresh:
            raw, jacobians = yield from slopes(model, evidence, fit.point)
            fit = Estimate.at(model, evidence, fit.point, raw, jacobians)
    return fit


def residuals(raw: Sequence[Residuals], evidence: Evidence) -> tuple[Array, ...]:
    """Whitened residuals (n,) of each run."""
    return tuple(whiten(a, s) for a, s in zip(raw, evidence.scales, strict=True))


def _line_search(fit: Estimate, curvature: Array, step: Array) -> Task[Estimate]:
    """Trial of the full step from `fit` or, where that gains nothing, the best along a parabola."""
    full = (yield from _evaluate(fit, [fit.z + step]))[0]
    if full.objective_at(fit.scale) < fit.objective:
        return full
    bend = _second_order_step(fit, full, curvature, step)
    points = [fit.z + f * step + f * f * bend for f in PARABOLA]
    trials = yield from _evaluate(fit, [*points, fit.z + PARABOLA[-1] * step])
    return min(trials, key=lambda trial: trial.objective_at(fit.scale))


def _second_order_step(fit: Estimate, full: Estimate, curvature: Array, step: Array) -> Array:
    """Second-order part (size,) of the path to the minimum (geodesic acceleration, Transtrum 2012).

    What the residuals did beyond the linear promise in the `full` step is answered by the same
    linear model; weak directions, along which that was too bold, are damped.
    """
    place, gradient = fit.place, np.zeros_like(step)
    rows = zip(fit.residuals, full.residuals, fit.jacobians, strict=True)
    for i, (before, after, jacobian) in enumerate(rows):
        at = place.columns(i)
        beyond = after - before - jacobian @ step[at]
        gradient[at] += jacobian.T @ beyond / fit.scale**2
    damped = curvature + DAMPING * np.diag(np.diag(curvature))
    return normal_equations.bounded_step(
        normal_equations.Normal(gradient, damped), full.z, fit.limits
    )


def _broyden_update(fit: Estimate, trial: Estimate, curvature: Array) -> tuple[Array, ...]:
    """Jacobians by run after the step from `fit` to `trial`, by Broyden's update (1965).

    They give the change of the residuals that was seen, at least change in units of what each
    unknown does; samples that either side lost change nothing.
    """
    place, change = fit.place, trial.z - fit.z
    updated, units = [], np.diag(curvature)
    rows = zip(fit.raw, trial.raw, fit.evidence.scales, fit.jacobians, strict=True)
    for i, (a, b, scale, jacobian) in enumerate(rows):
        columns = place.columns(i)
        step, along = change[columns], units[columns] * change[columns]
        beyond = np.nan_to_num((b.mean - a.mean) / scale - jacobian @ step)
        updated.append(
            jacobian + np.outer(beyond, along) / max(float(along @ step), np.finfo(float).tiny)
        )
    return tuple(updated)


def _evaluate(fit: Estimate, points: Sequence[Array]) -> Task[list[Estimate]]:
    """Trials at `points` (size,), clipped to the bounds, with the Jacobians of `fit`; simulates."""
    model, evidence, place, limits = fit.model, fit.evidence, fit.place, fit.limits
    inside = [place.unpack(np.clip(p, limits.low, limits.high)) for p in points]
    answers = yield [q for p in inside for q in requests(model, evidence.runs, p)]
    runs = len(evidence.runs)
    by_point = [answers[i * runs : (i + 1) * runs] for i in range(len(inside))]
    return [
        Estimate.at(model, evidence, p, raw, fit.jacobians)
        for p, raw in zip(inside, by_point, strict=True)
    ]


def final_fit(estimate: Estimate) -> Task[Estimate]:
    """Refit `estimate` with two-sided slopes, weighting down samples that respond nonlinearly."""
    start = yield from _with_slope_errors(estimate)
    refitted = yield from refit(
        start.model, start.evidence, start.point, start.jacobians, both_ways=True
    )
    if np.array_equal(refitted.shared, start.shared):
        return start
    return (yield from _with_slope_errors(refitted))


def _with_slope_errors(estimate: Estimate) -> Task[Estimate]:
    """Copy of `estimate` with two-sided slopes, whose error counts as noise of the samples.

    It is the mean square of what the linear model gets wrong of a step to either side. Samples that
    jump together err together, and count as one: by Kish's effective size (1965, Survey Sampling)
    of the error of a step in a run. Statistical linear regression: Lefebvre, Bruyninckx and De
    Schutter 2002, IEEE Transactions on Automatic Control 47, 1406.
    """
    model, known, point = estimate.model, estimate.evidence, estimate.point
    raw, right, left = yield from both_sides(model, known, point)
    scales, slopes = [], []
    for run, scale, a, b in zip(known.runs, known.scales, right, left, strict=True):
        step = np.array([p.step for p in (*model.parameters, *run.local)])
        slope = minmod(a, b)
        error = 0.5 * ((a - slope) ** 2 + (b - slope) ** 2) * step**2
        effective_size = error.sum(axis=0) ** 2 / np.maximum((error**2).sum(axis=0), 1e-300)
        wider = np.sqrt(1.0 + error @ effective_size)
        scales.append(scale * wider)
        slopes.append(slope / wider[:, None])
    return Estimate.at(model, replace(known, scales=tuple(scales)), point, raw, tuple(slopes))
