"""Local quadratic model of a fit: its unknowns, normal equations, and steps within
bounds.
"""

from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve

from cell.gap.fitting.model import Model, Point
from cell.gap.subject.subject import FitRun, starts
from drivers.base.types import Array
from drivers.strip.effects.effect import Parameter

Mask = NDArray[np.bool_]
# of the diagonal: holds directions that nothing determines; above rounding
RIDGE = 1e-9


class Unknowns(NamedTuple):
    """Unknowns of a fit in one vector (size,): P shared ones, then those of each run.

    `shared` is P, `local` the number of unknowns of each run; by unknown (size,): its
    bounds `low` and `high`, its prior `mean` and `precision`, the inverse variance.
    """

    parameters: tuple[Parameter, ...]
    shared: int
    local: Sequence[int]
    low: Array
    high: Array
    mean: Array
    precision: Array

    @classmethod
    def of(cls, model: Model, runs: Sequence[FitRun]) -> Self:
        """Unknowns of a fit of `model` to `runs`."""
        shared = model.parameters
        every = (*shared, *(p for run in runs for p in run.local))
        return cls(
            parameters=every,
            shared=len(shared),
            local=[len(run.local) for run in runs],
            low=np.array([p.low for p in every]),
            high=np.array([p.high for p in every]),
            mean=starts(every),
            precision=np.array([p.spread**-2 for p in every]),
        )

    def columns(self, run: int) -> NDArray[np.int64]:
        """Positions (P + k,) in the vector of unknowns of the P shared ones and of the
        k of run number `run`.
        """
        first = self.shared + sum(self.local[:run])
        return np.concatenate(
            [np.arange(self.shared), first + np.arange(self.local[run])]
        )

    def point(self, z: Array) -> Point:
        """Split the vector of values `z` (size,), clipped to its bounds, into shared
        values and those of each run.
        """
        edges = np.cumsum([self.shared, *self.local])
        shared, *local = np.split(np.clip(z, self.low, self.high), edges[:-1])
        return Point(shared, local)


class NormalEquations(NamedTuple):
    """Quadratic model of an objective [nats]: its `gradient` (n,) and `curvature` (n,
    n).
    """

    gradient: Array
    curvature: Array

    def decrease(self, step: Array) -> float:
        """Decrease of the objective [nats] that the quadratic model predicts for `step`
        (n,).
        """
        return float(-self.gradient @ step - 0.5 * step @ self.curvature @ step)

    def bounded_step(self, low: Array, high: Array) -> Array:
        """Step (n,) to the objective's minimum between the bounds `low` (n,) and `high`
        (n,), by an active-set method.

        Unknowns that the step would carry over a bound are put on it and leave the
        system; they come back while the gradient there pulls them inside (Lawson and
        Hanson 1974, chapter 23).
        """
        gradient = self.gradient
        diagonal = np.diag(self.curvature)
        ridged = self.curvature + np.diag(RIDGE * diagonal + 1e-300)
        step = best = np.zeros_like(gradient)
        felt = diagonal > 0.0
        free = felt & ~_pushed_out(gradient, step, low, high)

        least = 0.0
        for _ in range(len(step) + 3):
            step, free = _minimise_free(
                gradient, curvature=ridged, step=step, free=free, low=low, high=high
            )
            slope = gradient + ridged @ step
            value = 0.5 * float(step @ (gradient + slope))
            if value < least:
                best = step
                least = value

            inside = (low < high) & ~_pushed_out(slope, step, low, high)
            back = felt & inside & ~free
            if not back.any():
                break

            pull = np.where(back, np.abs(slope) / np.sqrt(diagonal + 1e-300), -1.0)
            free[np.argmax(pull)] = True

        return best


def _minimise_free(
    gradient: Array, curvature: Array, step: Array, free: Mask, low: Array, high: Array
) -> tuple[Array, Mask]:
    """Step (n,) to the minimum over `free` (n,) unknowns, and a mask (n,) of those
    still free.

    Unknowns that leave their bounds `low` (n,) and `high` (n,) are held on them; the
    others stay at `step` (n,).
    """
    step = step.copy()
    free = free.copy()
    while free.any():
        held = ~free
        right = gradient[free] + curvature[np.ix_(free, held)] @ step[held]
        step[free] = -_solve(curvature[np.ix_(free, free)], right)
        inside = np.clip(step, low, high)
        over = free & (step != inside)
        if not over.any():
            break

        step[over] = inside[over]
        free &= ~over
    return step, free


def _pushed_out(slope: Array, step: Array, low: Array, high: Array) -> Mask:
    """Mask (size,) of unknowns on a bound that the gradient pushes outwards."""
    return (step <= low) & (slope >= 0.0) | (step >= high) & (slope <= 0.0)


def _solve(matrix: Array, right: Array) -> Array:
    """Solve a symmetric positive definite system `matrix` x = `right` for x (n,),
    scaled to a unit diagonal first.
    """
    unit, scaled = _scaled(matrix)
    ridge = 1e-12 * np.eye(len(unit))
    return unit * np.linalg.solve(scaled + ridge, unit * right)


def covariance(curvature: Array) -> Array:
    """Inverse (size, size) of a `curvature` matrix (size, size); large but finite where
    that is singular.
    """
    unit, scaled = _scaled(curvature)
    values, vectors = np.linalg.eigh(scaled)
    inverse = (vectors / np.maximum(values, 1e-12)) @ vectors.T
    covariance: Array = inverse * unit[:, None] * unit
    return covariance


def inverse_and_logdet(curvature: Array) -> tuple[Array, float]:
    """Inverse (size, size) of a positive definite `curvature`, and half the log
    determinant of `curvature`.
    """
    unit, scaled = _scaled(curvature)
    identity = np.eye(len(unit))
    lower = np.linalg.cholesky(scaled + 1e-10 * identity)
    inverse = cho_solve((lower, True), identity) * unit[:, None] * unit
    return inverse, np.log(np.diag(lower) / unit).sum()


def _scaled(matrix: Array) -> tuple[Array, Array]:
    """Scale a symmetric `matrix` (size, size) to a unit diagonal; returns the factors
    (size,) on rows and columns, and the scaled matrix.
    """
    unit = 1.0 / np.sqrt(np.maximum(np.diag(matrix), 1e-280))
    return unit, matrix * unit[:, None] * unit
