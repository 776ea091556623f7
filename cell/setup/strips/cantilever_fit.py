"""Bending length from one photograph: fit of the heavy elastica to a strip's midline.

A least-squares problem: residuals, Jacobian and cost of the unknowns. The rest
curvature of the strip has a prior of its own: none, constant, varying.
"""

from dataclasses import dataclass, replace
from enum import StrEnum
from operator import attrgetter

import numpy as np
from scipy.optimize import least_squares

from cell.setup.strips.photograph import Photograph
from drivers.base.geometry import (
    interpolate_columns,
    left_normals,
    rotation,
    unit,
)
from drivers.base.types import Array
from drivers.strip.cantilever import HangingStrip, NoRest, hanging_shape, hinges

# place of each unknown, and of the first coefficient of the rest curvature's fields
LN_LENGTH, LEDGE, ROLL, CLAMP, X, Z, FIRST_FIELD = range(7)
TYPICAL = 0.02  # m, bending length
LN_SPREAD, MOST_LN_LENGTH = 1.5, 4.0  # of ln(bending length) around the typical one
# widths, or m, between picture's border and ledge
LEDGE_WIDTHS, LEDGE_SPREAD = 0.7, 0.002
ROLL_SPREAD = 0.02  # rad
CLAMP_SPREAD = 0.02  # rad
TIP = 0.3  # widths, one sigma of where the midline ends
ROBUST = 2.5  # sigmas from which a miss counts less: Huber's loss
KNOT_SPACING = 2.0  # widths: over less no strip changes its set
MOST_KNOTS = 60
RULER = 0.001  # m, one sigma of a measured overhang
FIRST_SIGMA = 12.0  # times sigma for the first fit, which has to find its way
START_LENGTHS = (0.5, 1.0, 2.5)  # typical bending lengths from which it sets out
ITERATIONS = 80
COST_TOLERANCE = 1e-5  # of the cost


class RestCurvature(StrEnum):
    """Kinds of curvature that a strip without load may have: none, the same everywhere
    (a curl), or varying along the strip (a set).
    """

    STRAIGHT = "straight"
    CURLED = "curled"
    SET = "set"


@dataclass(frozen=True, slots=True)
class RestCurvaturePrior:
    """What is assumed of the curvature of a strip without load: its kind, and its
    standard deviation `spread` [1/m].
    """

    kind: RestCurvature
    spread: float = 0.0

    def fields(self, overhang: float, width: float) -> Array:
        """Curvatures [1/m], of shape (hinges, unknowns), whose columns, each times a
        standard normal number, add up to the curvature of the strip without load at
        each point where it bends.

        A curl is one constant field. A set adds one at each knot, independent of the
        others.
        """
        arc = hinges(overhang)
        if self.kind is RestCurvature.STRAIGHT:
            return np.zeros((len(arc), 0))
        constant = np.full((len(arc), 1), self.spread)
        if self.kind is RestCurvature.CURLED:
            return constant
        count = int(np.clip(overhang / (KNOT_SPACING * width), 4, MOST_KNOTS)) + 1
        knots = np.linspace(0.0, overhang, count)
        tents = interpolate_columns(arc, knots, np.eye(count))
        return np.concatenate([constant, self.spread * tents], axis=1)


@dataclass(frozen=True, slots=True)
class TrialShape:
    """Shape of a hanging strip for one set of unknowns, its distances from the
    photographed midline, and the derivatives of these.

    `misses` (2 n,) from the midline, across and then along it, in sigmas, `slopes` (2
    n, p) their negative derivatives by the values.
    """

    hanging: HangingStrip
    misses: Array
    slopes: Array


class MidlineProblem:
    """Least-squares problem that fits a hanging strip to the midline in one photograph,
    with what is assumed of its curvature without load.

    The unknowns are ln(bending length / typical), the ledge's arc length behind the
    picture's border, the camera's roll, the angle at which the strip leaves the ledge,
    the ledge's place, and the deviates of the rest curvature. All but the place have a
    normal prior.
    """

    def __init__(self, photograph: Photograph, prior: RestCurvaturePrior) -> None:
        self.photograph = photograph
        self.prior = prior
        self._fields = prior.fields(photograph.overhang, photograph.width)
        self.size = FIRST_FIELD + self._fields.shape[1]

        sigmas = np.ones(self.size)  # of the normal priors
        sigmas[LN_LENGTH] = LN_SPREAD
        sigmas[LEDGE] = max(LEDGE_WIDTHS * photograph.width, LEDGE_SPREAD)
        sigmas[[ROLL, CLAMP]] = ROLL_SPREAD, CLAMP_SPREAD
        sigmas[[X, Z]] = np.inf
        self._weights = 1 / sigmas
        self._local_frames = _local_frames(photograph)

    def trial(self, values: Array) -> TrialShape:
        """Shape of the strip for the unknowns `values`, of shape (unknowns,), and its
        distances from the midline; NoRest where the strip finds no equilibrium.
        """
        measured = self.photograph
        hanging = hanging_shape(
            measured.overhang,
            TYPICAL * float(np.exp(values[LN_LENGTH])),
            rest_curvature=self._fields @ values[FIRST_FIELD:],
            clamp_angle=float(values[CLAMP]),
        )

        scale = 1 - values[LEDGE] / measured.overhang
        arc = (measured.arc - values[LEDGE]) / scale
        along = _Samples(hanging, arc, float(values[CLAMP]))
        turn = rotation(values[ROLL])
        curve = scale * along.points @ turn.T

        # of the strip's points, per unknown
        motions = np.empty((len(curve), 2, self.size))
        motions[..., LN_LENGTH] = scale * along.at(hanging.moved_by_bending_length())
        # arc length per metre of the ledge
        slid = (measured.arc / measured.overhang - 1) / scale
        shrunk = along.points / measured.overhang
        motions[..., LEDGE] = slid[:, None] * along.tangents - shrunk
        motions[..., CLAMP] = scale * along.moved_by_clamp_angle()
        motions[..., FIRST_FIELD:] = scale * along.at(
            hanging.moved_by_rest_curvature(self._fields)
        )
        motions = np.einsum("ab,nbp->nap", turn, motions)
        motions[..., ROLL] = curve[:, ::-1] * (-1, 1)
        motions[..., [X, Z]] = np.eye(2)

        misses = self._project_motion(measured.points - values[[X, Z]] - curve)
        return TrialShape(hanging, misses, self._project_motion(motions))

    def residuals(self, values: Array) -> Array:
        """Residuals, of shape (residuals,) and in standard deviations, at the unknowns
        `values`: distances from the midline, then deviations of the unknowns from what
        is assumed of them.
        """
        try:
            misses = self.trial(values).misses
        except NoRest:
            misses = np.full(2 * len(self.photograph.points), np.nan)
        return np.concatenate([misses, values * self._weights])

    def jacobian(self, values: Array) -> Array:
        """Derivatives of the residuals by the unknowns at `values`, an array of shape
        (residuals, unknowns).
        """
        return np.concatenate([-self.trial(values).slopes, np.diag(self._weights)])

    def loss(self, squares: Array) -> Array:
        """Loss of each squared residual and its first two derivatives, of shape (3,
        residuals): outliers of the midline count less, deviations of the unknowns in
        full.
        """
        is_far = squares > ROBUST**2
        is_far[-self.size :] = False  # priors
        sigmas = np.sqrt(squares.clip(ROBUST**2))
        loss = np.where(is_far, 2 * ROBUST * sigmas - ROBUST**2, squares)
        weight = np.where(is_far, ROBUST / sigmas, 1.0)
        # without curvature: reweighting
        return np.array([loss, weight, np.zeros_like(loss)])

    def precision(self, values: Array) -> Array:
        """Inverse of the covariance of the unknowns at `values`, an array of shape
        (unknowns, unknowns).
        """
        slopes = self.jacobian(values)
        _, weight, _ = self.loss(self.residuals(values) ** 2)
        precision: Array = slopes.T @ (weight[:, None] * slopes)
        return precision

    def _project_motion(self, motion: Array) -> Array:
        """Components of `motion`, a row of two numbers for each point of the midline,
        across and along it, in standard deviations.
        """
        parts = np.einsum("knc,nc...->kn...", self._local_frames, motion)
        components: Array = parts.reshape(-1, *motion.shape[2:])
        return components


class _Samples:
    """Points of a hanging strip at the arc lengths `arc` [m]; the strip is straight
    before the ledge over which it hangs.
    """

    def __init__(self, hanging: HangingStrip, arc: Array, clamp_angle: float) -> None:
        spans = np.diff(hanging.arc)
        self._hanging = hanging
        self._index = np.clip(np.searchsorted(hanging.arc, arc) - 1, 0, len(spans) - 1)
        self._share = np.clip(
            (arc - hanging.arc[self._index]) / spans[self._index], 0.0, 1.0
        )
        self._before = np.minimum(arc, 0.0)[:, None]
        angles = np.where(arc < 0, clamp_angle, hanging.angles[self._index])
        straight = (np.cos(clamp_angle), np.sin(clamp_angle))
        self.tangents = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        self.points = self.at(hanging.points) + self._before * straight
        self._swing = self._before * (-straight[1], straight[0])

    def at(self, nodes: Array) -> Array:
        """Values at the points, interpolated linearly from values at the nodes of the
        hanging strip, which are the rows of `nodes`.
        """
        share = self._share.reshape(-1, *[1] * (nodes.ndim - 1))
        before = nodes[self._index]
        after = nodes[self._index + 1]
        values: Array = (1 - share) * before + share * after
        return values

    def moved_by_clamp_angle(self) -> Array:
        """Motion [m] of each point per radian by which the strip turns at the ledge, a
        row of two numbers for each.
        """
        motion: Array = self.at(self._hanging.moved_by_clamp_angle()) + self._swing
        return motion


def _local_frames(photograph: Photograph) -> Array:
    """Normals and tangents of the photographed midline, one of each for every point,
    divided by the standard deviation of the midline in that direction [m].

    Along the midline all points shift together, by the uncertainty of its tip.
    """
    tangents = unit(np.gradient(photograph.points, axis=0))
    normals = left_normals(tangents) / photograph.sigma[:, None]
    slip = TIP * photograph.width * np.sqrt(len(tangents))
    return np.stack([normals, tangents / slip])


STRAIGHT = RestCurvaturePrior(RestCurvature.STRAIGHT)


@dataclass(frozen=True, slots=True)
class Fit:
    """Fit of a hanging strip to one photograph: the most probable unknowns, in
    `values`, and their `covariance`.

    `misses` (n,) [m] are the residuals of the midline across the curve, `evidence` the
    log of the probability of the midline under `prior` (up to a constant common to all
    priors).
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
        """Bending length [m]: the cube root of rigidity over weight per length (Peirce
        1930).
        """
        return self.hanging.bending_length

    @property
    def sigma(self) -> float:
        """Standard deviation of the logarithm of the bending length, with errors of the
        ruler and of the strip's tip.
        """
        end = np.hypot(RULER, TIP * self.photograph.width) / self.photograph.overhang
        return float(np.hypot(np.sqrt(self.covariance[LN_LENGTH, LN_LENGTH]), end))

    @property
    def ledge(self) -> float:
        """Distance [m] along the strip from the picture's border, where it enters, to
        the ledge over which it hangs.
        """
        return float(self.values[LEDGE])

    @property
    def rms(self) -> float:
        """Root mean square of the midline's distances from the fitted strip [m]."""
        return float(np.sqrt(np.mean(self.misses**2)))

    @property
    def rest_curvature(self) -> Array:
        """Curvature [1/m] of the fitted strip without load, at each point where it
        bends; a positive one turns its free end up.
        """
        width = self.photograph.width
        overhang = self.photograph.overhang
        fields = self.prior.fields(overhang, width)
        curvature: Array = fields @ self.values[FIRST_FIELD:]
        return curvature

    @property
    def curl(self) -> tuple[float, float]:
        """Mean curvature [1/m] of the strip without load, and its standard deviation
        [1/m].
        """
        fields = self.prior.fields(self.photograph.overhang, self.photograph.width)
        mean = np.diff(self.hanging.arc) / self.photograph.overhang @ fields
        variance = mean @ self.covariance[FIRST_FIELD:, FIRST_FIELD:] @ mean
        return float(mean @ self.values[FIRST_FIELD:]), float(np.sqrt(variance))

    def curve(self) -> Array:
        """Points [px] of the fitted strip in the picture, from the ledge to its tip, a
        row of two coordinates for each.
        """
        scale = 1 - self.values[LEDGE] / self.photograph.overhang
        points = scale * self.hanging.points @ rotation(self.values[ROLL]).T
        pixels: Array = (self.values[[X, Z]] + points) / self.photograph.pixel
        pixels[:, 1] *= -1  # rows count downwards
        return pixels


def fit_photograph(
    photograph: Photograph, prior: RestCurvaturePrior, start: Fit | None = None
) -> Fit:
    """Fit a strip to one photograph with what `prior` assumes of its curvature without
    load, from the fit `start` or, where that is None, from a coarse one.
    """
    if start is None:
        start = _fit_straight(photograph)
    problem = MidlineProblem(photograph, prior)
    values = np.zeros(problem.size)
    values[:FIRST_FIELD] = start.values[:FIRST_FIELD]
    if len(start.values) == len(values) > FIRST_FIELD:
        values[FIRST_FIELD:] = (
            start.values[FIRST_FIELD:] * start.prior.spread / prior.spread
        )
    return _minimise(problem, values)


def _fit_straight(photograph: Photograph) -> Fit:
    """Coarse fit of a strip that is straight without load: the best of the fits that
    begin at several bending lengths.
    """
    problem = MidlineProblem(
        replace(photograph, sigma=FIRST_SIGMA * photograph.sigma), STRAIGHT
    )
    fits = []
    for start in START_LENGTHS:
        values = np.zeros(problem.size)
        values[LN_LENGTH] = np.log(start)
        values[[X, Z]] = photograph.points[0]
        fits.append(_minimise(problem, values))
    return max(fits, key=attrgetter("evidence"))


def _minimise(problem: MidlineProblem, values: Array) -> Fit:
    """Fit that begins at the unknowns `values`: the most probable ones, with a normal
    approximation of their distribution.
    """
    bounds = np.full(problem.size, np.inf)
    bounds[LN_LENGTH] = MOST_LN_LENGTH
    solution = least_squares(
        problem.residuals,
        values,
        problem.jacobian,
        (-bounds, bounds),
        x_scale="jac",
        loss=problem.loss,
        ftol=COST_TOLERANCE,
        max_nfev=ITERATIONS,
    )
    best = problem.trial(solution.x)
    matrix = problem.precision(solution.x)
    return Fit(
        photograph=problem.photograph,
        prior=problem.prior,
        values=solution.x,
        covariance=np.asarray(np.linalg.inv(matrix)),
        hanging=best.hanging,
        misses=best.misses[: len(problem.photograph.arc)] * problem.photograph.sigma,
        evidence=-float(solution.cost + 0.5 * np.linalg.slogdet(matrix)[1]),
    )
