"""Jacobians by finite differences: secants by each parameter's step, to one side or both.

Near where a motion goes another way, a small step to one side makes samples jump. A secant over
the jump is no slope: its height would settle a fit and make its intervals as narrow as the jump is
steep.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cell.gap.fitting.model import Evidence, Model, Point, request
from cell.gap.fitting.tasks import Task, side_by_side
from cell.gap.subject.subject import Parameter, Request, Residuals, Run
from drivers.types import Array

Linearised = tuple[Sequence[Residuals], tuple[Array, ...]]


def linearise(model: Model, evidence: Evidence, point: Point) -> Task[Linearised]:
    """Residuals and whitened secants (n, shared + local) of each run; yields simulations."""
    asked: list[Request] = []
    steps: list[Array] = []
    for run, local in zip(evidence.runs, point.local, strict=True):
        own_requests, own_steps = _secant_requests(model, run, point.shared, local)
        asked += own_requests
        steps.append(own_steps)
    answers = yield asked
    raw, jacobians, at = [], [], 0
    for h, scale in zip(steps, evidence.scales, strict=True):
        mine = answers[at : at + 1 + len(h)]
        at += len(mine)
        raw.append(mine[0])
        jacobians.append(secants(mine[0], mine[1:], scale, h))
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


def secants(here: Residuals, moved: Sequence[Residuals], scale: Array, steps: Array) -> Array:
    """Whitened finite differences (n, len(steps)), zero where a residual is lost."""
    columns = [(m.mean - here.mean) / scale / h for m, h in zip(moved, steps, strict=True)]
    matrix = np.array(columns).reshape(len(columns), len(scale)).T
    return np.asarray(np.nan_to_num(matrix, nan=0.0, posinf=0.0, neginf=0.0))


def _secant_requests(
    model: Model, run: Run, shared: Array, local: Array
) -> tuple[list[Request], Array]:
    """Requests at the values and one step of each unknown away, and the steps (k,)."""
    asked = [request(model, run, shared, local)]
    steps = []
    for i, p in enumerate(model.parameters):
        h = _step_within_bounds(p, shared[i])
        asked.append(request(model, run, _step_one(shared, i, h), local))
        steps.append(h)
    for i, p in enumerate(run.local):
        h = _step_within_bounds(p, local[i])
        asked.append(request(model, run, shared, _step_one(local, i, h)))
        steps.append(h)
    return asked, np.array(steps)


def _step_within_bounds(p: Parameter, value: float) -> float:
    return p.step if p.low <= value + p.step <= p.high else -p.step


def _step_one(values: Array, i: int, h: float) -> Array:
    moved = values.copy()
    moved[i] += h
    return moved
