"""Bending length from one photograph: fit of the heavy elastica to the midline."""

from dataclasses import dataclass, replace

import numpy as np

from cell.strips.photograph import Photograph
from cell.strips.problem import (
    FIRST_FIELD,
    LEDGE,
    LN_LENGTH,
    ROLL,
    STRAIGHT,
    TIP,
    Problem,
    RestCurvaturePrior,
    Trial,
    X,
    Z,
    rotation,
)
from drivers.strip.cantilever import HangingStrip, NoRest
from drivers.types import Array

RULER = 0.001  # m, one sigma of a measured overhang
FIRST_SIGMA = 12.0  # times sigma for the first fit, which has to find its way
START_LENGTHS = (0.5, 1.0, 2.5)  # typical bending lengths from which it sets out
ITERATIONS = 80
LARGEST_LOG_STEP = 0.3  # of ln(bending length)
COST_TOLERANCE = 1e-5  # of the cost
LM_DAMPING, FACTOR, LARGEST_DAMPING = 1e-3, 8.0, 1e10


@dataclass(frozen=True, slots=True)
class Fit:
    """Fit of a hanging strip: unknowns `values` (p,) and their `covariance` (p, p).

    `misses` (n,) [m] are the residuals of the midline across the curve, `evidence` the log of the
    probability of the midline under `prior` (up to a constant common to all priors).
    """

    photograph: Photograph
    prior: RestCurvaturePrior
    values: Array
    covariance: Array
    hanging: HangingStrip
    misses: Array
    evidence: float

    @property
    def bending_length(self) -> float:
        """Bending length c [m]."""
        return self.hanging.bending_length

    @property
    def sigma(self) -> float:
        """Standard deviation of ln(bending length), ruler and tip included."""
        photograph = self.photograph
        end = np.hypot(RULER, TIP * photograph.width) / photograph.overhang
        return float(np.hypot(np.sqrt(self.covariance[LN_LENGTH, LN_LENGTH]), end))

    @property
    def ledge(self) -> float:
        """Distance [m] along the strip from the picture's border to the ledge."""
        return float(self.values[LEDGE])

    @property
    def rms(self) -> float:
        """Root mean square of the fit's residuals [m]."""
        return float(np.sqrt(np.mean(self.misses**2)))

    @property
    def rest_curvature(self) -> Array:
        """Rest curvature (hinges,) [1/m]; a positive one turns the free end up."""
        width, overhang = self.photograph.width, self.photograph.overhang
        return np.asarray(self.prior.fields(overhang, width) @ self.values[FIRST_FIELD:])

    @property
    def curl(self) -> tuple[float, float]:
        """Mean rest curvature along the strip and its standard deviation [1/m]."""
        fields = self.prior.fields(self.photograph.overhang, self.photograph.width)
        mean = np.diff(self.hanging.arc) / self.photograph.overhang @ fields
        variance = mean @ self.covariance[FIRST_FIELD:, FIRST_FIELD:] @ mean
        return float(mean @ self.values[FIRST_FIELD:]), float(np.sqrt(variance))

    def curve(self) -> Array:
        """Points (n, 2) u, v [px] of the fitted strip in the picture, from the ledge to the tip."""
        scale = 1 - self.values[LEDGE] / self.photograph.overhang
        points = scale * self.hanging.points @ rotation(self.values[ROLL]).T
        return np.asarray((self.values[[X, Z]] + points) / self.photograph.pixel * (1, -1))


def fit(photograph: Photograph, prior: RestCurvaturePrior, start: Fit | None = None) -> Fit:
    """Fit the most probable strip under `prior` to the photograph, starting from `start`."""
    if start is None:
        start = _fit_straight(photograph)
    problem = Problem(photograph, prior)
    values = np.zeros(problem.size)
    values[:FIRST_FIELD] = start.values[:FIRST_FIELD]
    if len(start.values) == len(values) > FIRST_FIELD:
        values[FIRST_FIELD:] = start.values[FIRST_FIELD:] * start.prior.spread / prior.spread
    return _minimise(problem, values)


def _fit_straight(photograph: Photograph) -> Fit:
    """Fit a straight strip coarsely from several bending lengths; returns the best of them."""
    problem = Problem(replace(photograph, sigma=FIRST_SIGMA * photograph.sigma), STRAIGHT)
    found = []
    for start in START_LENGTHS:
        values = np.zeros(problem.size)
        values[LN_LENGTH] = np.log(start)
        values[[X, Z]] = photograph.points[0]
        found.append(_minimise(problem, values))
    return max(found, key=lambda each: each.evidence)


def _minimise(problem: Problem, values: Array) -> Fit:
    """Minimise the problem's cost from `values` (p,) by Levenberg-Marquardt."""
    here = problem.trial(values)
    damping = LM_DAMPING
    for _ in range(ITERATIONS):
        there, damping = _damped_step(problem, here, damping)
        if there is None:
            break
        gain, here = here.cost - there.cost, there
        if gain < COST_TOLERANCE * (1 + here.cost):
            break
    matrix, _ = problem.normal_equations(here)
    return Fit(
        photograph=problem.photograph,
        prior=problem.prior,
        values=here.values,
        covariance=np.asarray(np.linalg.inv(matrix), dtype=np.float64),
        hanging=here.hanging,
        misses=here.misses[: len(problem.photograph.arc)] * problem.photograph.sigma,
        evidence=-0.5 * float(here.cost + np.linalg.slogdet(matrix)[1]),
    )


def _damped_step(problem: Problem, here: Trial, damping: float) -> tuple[Trial | None, float]:
    """Make one Levenberg-Marquardt step; returns a better trial or None, and the next damping."""
    matrix, downhill = problem.normal_equations(here)
    while damping < LARGEST_DAMPING:
        step = np.linalg.solve(matrix + damping * np.diag(np.diag(matrix)), downhill)
        step[LN_LENGTH] = np.clip(step[LN_LENGTH], -LARGEST_LOG_STEP, LARGEST_LOG_STEP)
        try:
            there = problem.trial(here.values + step)
        except NoRest:
            there = here
        if there.cost < here.cost:
            return there, damping / FACTOR
        damping *= FACTOR
    return None, damping
