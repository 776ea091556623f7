"""Robust Gauss-Newton fit of a model to runs, with Jacobians by secants.

Shared parameters and each run's own unknowns are estimated jointly. Simulations are expensive and
responses nearly linear, so that a Jacobian is kept while it predicts the decrease well. Close to a
bifurcation a small step makes samples jump, and a one-sided secant across the jump is no slope: it
would stop the fit and make its intervals too narrow. So the final fit uses two-sided slopes.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from cell.gap.fitting import normal_equations, robust
from cell.gap.fitting.model import Evidence, Model, Point, request, requests, whiten
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


@dataclass(frozen=True, slots=True)
class StepControl:
    """Step control of a Gauss-Newton fit, in shares of the decrease that a step predicted.

    A fit ends after `steps`. A Jacobian is kept where the decrease is in the range `trusted`; in
    the range `mendable` Broyden's update corrects it, once. Less than `stalled` with fresh
    Jacobians, twice, ends the fit: the objective is not smooth. A step too long is tried at
    the shares `parabola` of its length, bent by a term of relative `damping`. Source: set by hand.
    """

    steps: int = 20
    trusted: tuple[float, float] = (0.7, 1.4)
    mendable: tuple[float, float] = (0.3, 2.5)
    stalled: float = 0.1
    parabola: tuple[float, ...] = (1.0, 0.5, 0.25, 0.1, 0.02)
    damping: float = 1e-3


STEP_CONTROL = StepControl()


@dataclass(frozen=True, slots=True)
class Estimate:
    """A fitted model: its values, residuals and Jacobians.

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

    def normal(self, scale: float | None = None) -> normal_equations.Normal:
        """Normal equations of data and priors at dispersion `scale` (default: its own)."""
        dispersion = self.scale if scale is None else scale
        data = normal_equations.normal(self.place, self.residuals, self.jacobians, dispersion)
        return normal_equations.with_prior(data, self.z, self.limits)

    def on(self, indices: Sequence[int]) -> "Estimate":
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


def refit(
    model: Model,
    evidence: Evidence,
    start: Point,
    jacobians: tuple[Array, ...] | None = None,
    enough: float = FINAL_GAIN,
    steps: int = STEP_CONTROL.steps,
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
    z = np.clip(place.pack(start), limits.low, limits.high)
    fresh, mended, stalled = jacobians is None, False, 0
    if jacobians is None:
        raw, jacobians = yield from slopes(model, evidence, place.unpack(z))
    else:
        raw = yield requests(model, evidence.runs, place.unpack(z))
    for _ in range(steps):
        r = residuals(raw, evidence)
        scale = robust.scale(np.concatenate(r))
        data = normal_equations.normal(place, r, jacobians, scale)
        equations = normal_equations.with_prior(data, z, limits)
        step = normal_equations.bounded_step(equations, z, limits)
        promised = normal_equations.decrease(equations, step)
        if promised < enough:
            break
        start_value = normal_equations.objective(r, z, limits, scale)
        search = _Search(
            model, evidence, place, limits, jacobians, equations.curvature, scale, start_value
        )
        trial = yield from _line_search(search, z, step, r)
        gain = start_value - trial.objective
        share = gain / promised
        if gain <= 0.0 and fresh:
            break
        stalled = stalled + 1 if fresh and share < STEP_CONTROL.stalled else 0
        trusted = STEP_CONTROL.trusted[0] < share < STEP_CONTROL.trusted[1]
        mended = (
            not trusted
            and not mended
            and STEP_CONTROL.mendable[0] < share < STEP_CONTROL.mendable[1]
        )
        fresh = not trusted and not mended
        if mended:
            jacobians = _broyden_update(search, trial.z - z, raw, trial.raw)
        if gain > 0.0:
            z, raw = trial.z, trial.raw
        if stalled > 1:
            break
        if fresh:
            raw, jacobians = yield from slopes(model, evidence, place.unpack(z))
    return estimate_at(model, evidence, place.unpack(z), raw, jacobians)


def estimate_at(
    model: Model,
    evidence: Evidence,
    point: Point,
    raw: Sequence[Residuals],
    jacobians: tuple[Array, ...],
) -> Estimate:
    """Estimate at `point` from residuals `raw` and whitened `jacobians` (n, size) by run."""
    limits = normal_equations.bounds(model, evidence)
    z = normal_equations.layout(model, evidence).pack(point)
    r = residuals(raw, evidence)
    scale = robust.scale(np.concatenate(r))
    total = normal_equations.objective(r, z, limits, scale)
    return Estimate(model, evidence, point, r, tuple(raw), jacobians, scale, total)


def residuals(raw: Sequence[Residuals], evidence: Evidence) -> tuple[Array, ...]:
    """Whitened residuals (n,) of each run."""
    return tuple(whiten(a, s) for a, s in zip(raw, evidence.scales, strict=True))


@dataclass(frozen=True, slots=True)
class _Search:
    """What a line search depends on; `start_value` is the objective [nats] at its start."""

    model: Model
    evidence: Evidence
    place: normal_equations.Layout
    limits: normal_equations.Bounds
    jacobians: tuple[Array, ...]
    curvature: Array
    scale: float
    start_value: float


@dataclass(frozen=True, slots=True)
class _Trial:
    z: Array
    raw: Sequence[Residuals]
    objective: float


def _line_search(search: _Search, z: Array, step: Array, r: Sequence[Array]) -> Task[_Trial]:
    """Trial of the full step or, where that gains nothing, the best along a parabola."""
    full = (yield from _evaluate(search, [z + step]))[0]
    if full.objective < search.start_value:
        return full
    bend = _second_order_step(search, z, step, r, residuals(full.raw, search.evidence))
    points = [z + f * step + f * f * bend for f in STEP_CONTROL.parabola]
    trials = yield from _evaluate(search, [*points, z + STEP_CONTROL.parabola[-1] * step])
    return min(trials, key=lambda trial: trial.objective)


def _second_order_step(
    search: _Search, z: Array, step: Array, before: Sequence[Array], after: Sequence[Array]
) -> Array:
    """Second-order part (size,) of the path to the minimum (geodesic acceleration, Transtrum 2012).

    What the residuals did beyond the linear promise is answered by the same linear model; weak
    directions, along which the full step was too bold, are damped.
    """
    place, limits = search.place, search.limits
    beyond = [
        b - a - jacobian @ step[place.columns(i)]
        for i, (a, b, jacobian) in enumerate(zip(before, after, search.jacobians, strict=True))
    ]
    gradient = np.zeros_like(z)
    for i, (d, jacobian) in enumerate(zip(beyond, search.jacobians, strict=True)):
        gradient[place.columns(i)] += jacobian.T @ d / search.scale**2
    damped = search.curvature + STEP_CONTROL.damping * np.diag(np.diag(search.curvature))
    inside = np.clip(z + step, limits.low, limits.high)
    return normal_equations.bounded_step(normal_equations.Normal(gradient, damped), inside, limits)


def _broyden_update(
    search: _Search, change: Array, before: Sequence[Residuals], after: Sequence[Residuals]
) -> tuple[Array, ...]:
    """Jacobians by run after the step `change` (size,), by Broyden's update (1965).

    They give the change of the residuals that was seen, at least change in units of what each
    unknown does; samples that either side lost change nothing.
    """
    updated, units = [], np.diag(search.curvature)
    rows = zip(before, after, search.evidence.scales, search.jacobians, strict=True)
    for i, (a, b, scale, jacobian) in enumerate(rows):
        columns = search.place.columns(i)
        step, along = change[columns], units[columns] * change[columns]
        beyond = np.nan_to_num((b.mean - a.mean) / scale - jacobian @ step)
        updated.append(
            jacobian + np.outer(beyond, along) / max(float(along @ step), np.finfo(float).tiny)
        )
    return tuple(updated)


def _evaluate(search: _Search, points: Sequence[Array]) -> Task[list[_Trial]]:
    """Trials at `points` (size,), each clipped to the bounds; yields simulations."""
    model, evidence = search.model, search.evidence
    place, limits = search.place, search.limits
    inside = [np.clip(p, limits.low, limits.high) for p in points]
    answers = yield [q for p in inside for q in requests(model, evidence.runs, place.unpack(p))]
    trials, runs = [], len(evidence.runs)
    for i, p in enumerate(inside):
        raw = answers[i * runs : (i + 1) * runs]
        value = normal_equations.objective(residuals(raw, evidence), p, limits, search.scale)
        trials.append(_Trial(p, raw, value))
    return trials


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
    return estimate_at(model, replace(known, scales=tuple(scales)), point, raw, tuple(slopes))
