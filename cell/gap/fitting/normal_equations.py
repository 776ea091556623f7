"""The local quadratic model of a fit: whitened Jacobians, normal equations, bounded steps."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cell.gap.fitting import robust
from cell.gap.fitting.model import Evidence, Model, Point, unknowns
from drivers.types import Array

Mask = NDArray[np.bool_]
RIDGE = 1e-9  # of the diagonal: holds directions that nothing determines; above rounding


@dataclass(frozen=True, slots=True)
class Layout:
    """Positions of the unknowns in one vector: shared ones first, then each run's own."""

    shared: int
    local: tuple[int, ...]

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self.shared + sum(self.local)

    def columns(self, run: int) -> NDArray[np.int64]:
        """Positions (shared + local,) of the shared unknowns and those of run number `run`."""
        first = self.shared + sum(self.local[:run])
        own = np.arange(first, first + self.local[run])
        return np.concatenate([np.arange(self.shared), own])

    def pack(self, point: Point) -> Array:
        """The point as one vector (size,)."""
        return np.concatenate([point.shared, *point.local])

    def unpack(self, z: Array) -> Point:
        """The vector `z` (size,) as a point."""
        edges = np.cumsum([self.shared, *self.local])
        parts = np.split(z, edges[:-1])
        return Point(parts[0], tuple(parts[1:]))


def layout(model: Model, evidence: Evidence) -> Layout:
    """Layout of a model's unknowns over some runs."""
    return Layout(len(model.parameters), tuple(len(run.local) for run in evidence.runs))


@dataclass(frozen=True, slots=True)
class Bounds:
    """Lowest and highest values, prior means and precisions of all unknowns (size,)."""

    low: Array
    high: Array
    mean: Array
    precision: Array


def bounds(model: Model, evidence: Evidence) -> Bounds:
    """Bounds and priors of a model's unknowns over some runs."""
    every = unknowns(model, evidence)
    return Bounds(
        low=np.array([p.low for p in every]),
        high=np.array([p.high for p in every]),
        mean=np.array([p.start for p in every]),
        precision=np.array([p.spread**-2 for p in every]),
    )


def objective(residuals: Sequence[Array], z: Array, limits: Bounds, scale: float) -> float:
    """Robust loss of all runs' residuals (n,) at `scale` plus the priors of `z` (size,) [nats]."""
    data = sum(float(robust.loss(r / scale).sum()) for r in residuals)
    return data + 0.5 * float(limits.precision @ (z - limits.mean) ** 2)


@dataclass(frozen=True, slots=True)
class Normal:
    """Gradient (size,) and curvature (size, size) of the objective in all unknowns [nats]."""

    gradient: Array
    curvature: Array


def normal(
    place: Layout,
    limits: Bounds,
    z: Array,
    residuals: Sequence[Array],
    jacobians: Sequence[Array],
    scale: float,
) -> Normal:
    """Weighted normal equations of the data, summed over runs, and of the priors at `z` (size,).

    By run: whitened `residuals` (n,) and `jacobians` (n, shared + local).
    """
    gradient, curvature = np.zeros(place.size), np.zeros((place.size, place.size))
    for i, (r, jacobian) in enumerate(zip(residuals, jacobians, strict=True)):
        weighted = jacobian * (robust.weights(r / scale) / scale**2)[:, None]
        at = place.columns(i)
        gradient[at] += weighted.T @ r
        curvature[np.ix_(at, at)] += weighted.T @ jacobian
    return Normal(
        gradient + limits.precision * (z - limits.mean), curvature + np.diag(limits.precision)
    )


def bounded_step(equations: Normal, z: Array, limits: Bounds) -> Array:
    """Step (size,) to the minimum of the quadratic model within the bounds, by active set.

    Unknowns that the step would carry over a bound are put on it and leave the system; held ones
    come back while the gradient there pulls them inside (Lawson and Hanson 1974, chapter 23).
    """
    diagonal = np.diag(equations.curvature)
    ridged = equations.curvature + np.diag(RIDGE * diagonal + 1e-300)
    low, high = limits.low - z, limits.high - z
    free = (diagonal > 0.0) & ~_pushed_out(equations.gradient, np.zeros_like(z), low, high)
    step, best, least = np.zeros_like(z), np.zeros_like(z), 0.0
    for _ in range(len(z) + 3):
        step, free = _minimise_free(equations.gradient, ridged, free, step, low, high)
        slope = equations.gradient + ridged @ step
        value = 0.5 * float(step @ (equations.gradient + slope))
        if value < least:
            best, least = step, value
        back = ~free & (diagonal > 0.0) & (low < high) & ~_pushed_out(slope, step, low, high)
        if not back.any():
            break
        pull = np.where(back, np.abs(slope) / np.sqrt(diagonal + 1e-300), -1.0)
        free[int(np.argmax(pull))] = True
    return best


def _minimise_free(
    gradient: Array, curvature: Array, free: Mask, step: Array, low: Array, high: Array
) -> tuple[Array, Mask]:
    """Step (size,) to the minimum over the `free` unknowns, and a mask of those still free.

    Unknowns that leave their bounds are held on them.
    """
    step, free = step.copy(), free.copy()
    while free.any():
        right = gradient[free] + curvature[np.ix_(free, ~free)] @ step[~free]
        step[free] = -_solve(curvature[np.ix_(free, free)], right)
        over = free & ((step < low) | (step > high))
        if not over.any():
            break
        step[over] = np.clip(step, low, high)[over]
        free &= ~over
    return step, free


def _pushed_out(slope: Array, step: Array, low: Array, high: Array) -> Mask:
    """Mask (size,) of unknowns on a bound whose slope holds them there."""
    return np.asarray((step <= low) & (slope >= 0.0) | (step >= high) & (slope <= 0.0))


def _solve(matrix: Array, right: Array) -> Array:
    """Solution of a symmetric positive system, scaled to a unit diagonal first."""
    d = 1.0 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    scaled = matrix * d[:, None] * d[None] + 1e-12 * np.eye(len(d))
    return np.asarray(d * np.linalg.solve(scaled, d * right))


def decrease(equations: Normal, step: Array) -> float:
    """Decrease of the objective [nats] that the quadratic model promises for `step` (size,)."""
    return float(-equations.gradient @ step - 0.5 * step @ equations.curvature @ step)


def covariance(curvature: Array) -> Array:
    """Inverse (size, size) of `curvature`: huge, not infinite, where it holds no information."""
    d = 1.0 / np.sqrt(np.maximum(np.diag(curvature), 1e-300))
    values, vectors = np.linalg.eigh(curvature * d[:, None] * d[None])
    inverse = (vectors / np.maximum(values, 1e-12)) @ vectors.T
    return np.asarray(inverse * d[:, None] * d[None])
