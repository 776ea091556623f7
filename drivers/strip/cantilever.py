"""Equilibrium of a strip that hangs over a ledge under its own weight: the heavy
elastica.

EI (theta' - kappa0)' = w (L - s) cos(theta), theta(0) = clamp angle, theta'(L) =
kappa0(L), with theta the tangent's angle above the horizontal and w the weight per
length (Bickley 1934). The strip is a chain of straight segments, finer at the ledge;
its energy is convex while it hangs, so Newton's method finds the one shape. Second
order in the length of the segments.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, cholesky_banded, solveh_banded

from drivers.base.errors import CellError
from drivers.base.geometry import left_normals, running_sums
from drivers.base.types import Array

SEGMENTS = 320
GRADING = 1.6  # arc = overhang t^GRADING at equal steps of t
ITERATIONS = 60
CONVERGED = 1e-10  # rad
LARGEST_STEP = 0.8  # rad by which one step of Newton's method turns a segment


class NoRest(CellError):
    """Error for a hanging strip of which there is, or was found, no equilibrium
    shape.
    """


@dataclass(frozen=True, slots=True)
class HangingStrip:
    """Equilibrium shape of a hanging strip, with the stiffness and loads for its
    derivatives.

    `points` (n + 1, 2) are x, z [m] from the ledge (0, 0), at arc lengths `arc` (n +
    1,) [m]; `angles` (n,) [rad] are those of the segments between them, from the
    horizontal up; `stiffness` (2, n) is the upper band of the energy's second
    derivative over EI [1/m], `pull` (n,) [1/m] the moment of the weight over EI.
    """

    bending_length: float
    arc: Array
    angles: Array
    points: Array
    stiffness: Array
    pull: Array

    def moved_by_bending_length(self) -> Array:
        """Derivative (n + 1, 2) [m] of the hanging strip's n + 1 points by the
        logarithm of its bending length.
        """
        turn = solveh_banded(self.stiffness, 3 * self.pull * np.cos(self.angles))
        return self._motion(turn[:, None])[..., 0]

    def moved_by_clamp_angle(self) -> Array:
        """Derivative (n + 1, 2) [m/rad] of the hanging strip's n + 1 points by the
        angle at which the ledge clamps it.
        """
        load = np.zeros(len(self.angles))
        load[0] = 1 / _spans(self.arc)[0]
        return self._motion(solveh_banded(self.stiffness, load)[:, None])[..., 0]

    def moved_by_rest_curvature(self, fields: Array) -> Array:
        """Derivatives (n + 1, 2, m) [m] of the hanging strip's points by the amounts of
        m rest curvatures.

        `fields` (n, m) are m distributions of it over the `hinges`.
        """
        load = fields.copy()
        load[:-1] -= fields[1:]
        return self._motion(solveh_banded(self.stiffness, load))

    def _motion(self, turn: Array) -> Array:
        """Displacements (n + 1, 2, m) [m] of the strip's points when its n segments
        turn by `turn` (n, m) [rad].
        """
        across = left_normals(_chords(self.angles, self.arc))
        return running_sums(across[:, :, None] * turn[:, None, :])


def segments(overhang: float) -> Array:
    """Arc lengths (n + 1,) [m] of a hanging strip's n + 1 nodes, denser
    near the ledge.
    """
    return overhang * np.linspace(0.0, 1.0, SEGMENTS + 1) ** GRADING


def hinges(overhang: float) -> Array:
    """Arc lengths (n,) [m] of a hanging strip's hinges, at the first node of each
    segment.
    """
    return segments(overhang)[:-1]


def hanging_shape(
    overhang: float,
    bending_length: float,
    *,
    rest_curvature: Array | None = None,
    clamp_angle: float = 0.0,
) -> HangingStrip:
    """Equilibrium of a strip of `bending_length` [m] that hangs over a ledge by
    `overhang` [m].

    `rest_curvature` (n,) [1/m] at the `hinges`, positive turns the free end up;
    `clamp_angle` [rad] above the horizontal. Raises NoRest where no stable shape is
    found or a length is <= 0.
    """
    where = f"a strip of bending length {bending_length:.4g} m over {overhang:.4g} m"
    if min(overhang, bending_length) <= 0:
        raise NoRest(f"{where}: no shape at rest; both lengths must be positive")

    arc = segments(overhang)
    spans = _spans(arc)
    middle = 0.5 * (arc[1:] + arc[:-1])
    pull = np.diff(arc) * (overhang - middle) / bending_length**3
    rest_turns = (
        np.zeros(len(pull)) if rest_curvature is None else rest_curvature * spans
    )
    angles = _start_angles(middle, overhang, bending_length) + clamp_angle
    angles, stiffness = _equilibrium(angles, rest_turns, spans, pull, clamp_angle)
    if stiffness is None:
        raise NoRest(
            f"{where}: no shape at rest was found in {ITERATIONS} Newton steps; check"
            " both lengths"
        )

    points = running_sums(_chords(angles, arc))
    return HangingStrip(bending_length, arc, angles, points, stiffness, pull)


def _equilibrium(
    angles: Array, rest_turns: Array, spans: Array, pull: Array, clamp_angle: float
) -> tuple[Array, Array | None]:
    """Solve for a hanging strip's segment angles (n,) [rad] at rest by Newton's method;
    also gives the energy's banded second derivative (2, n), None if no rest is found.
    """
    for _ in range(ITERATIONS):
        gradient, stiffness = _derivatives(angles, rest_turns, spans, pull, clamp_angle)
        if not np.isfinite(gradient).all():
            break
        step = _newton_step(gradient, stiffness, pull * np.sin(angles))
        turn = float(np.abs(step).max())
        angles = angles + step * min(
            1.0, LARGEST_STEP / max(turn, np.finfo(float).tiny)
        )
        if turn <= CONVERGED:
            return angles, stiffness if _stable(stiffness) else None
    return angles, None


def _newton_step(gradient: Array, stiffness: Array, lifting: Array) -> Array:
    """Newton step (n,) [rad] of a hanging strip's angles; `lifting` (n,) is added to
    the diagonal of an indefinite `stiffness` (2, n).
    """
    if not _stable(stiffness):
        stiffness = stiffness.copy()
        stiffness[1] += np.maximum(lifting, 0.0)
    step: Array = -solveh_banded(stiffness, gradient)
    return step


def _stable(stiffness: Array) -> bool:
    """Whether the banded matrix `stiffness` (2, n) is positive definite, as at a stable
    shape.
    """
    try:
        cholesky_banded(stiffness, check_finite=False)
    except LinAlgError:
        return False
    return True


def _chords(angles: Array, arc: Array) -> Array:
    """Vectors (n, 2) [m] of a strip's n segments at `angles` (n,) [rad] between nodes
    at arc lengths `arc` (n + 1,) [m].
    """
    return np.stack([np.cos(angles), np.sin(angles)], axis=1) * np.diff(arc)[:, None]


def _spans(arc: Array) -> Array:
    """Length (n,) [m] of strip that each hinge stands for: from the middle of one of
    its segments to that of the other.
    """
    lengths = np.diff(arc)
    spans: Array = 0.5 * (lengths + np.append(0.0, lengths[:-1]))
    return spans


def _start_angles(arc: Array, overhang: float, bending_length: float) -> Array:
    """Initial angles (n,) [rad] for Newton's method: a bend at the ledge, as the weight
    allows.
    """
    reach = bending_length * min(1.0, (bending_length / overhang) ** 0.5)
    turned = -0.5 * np.pi * min(1.0, (overhang / bending_length) ** 3 / 8)
    angles: Array = turned * (1 - np.exp(-arc / reach))
    return angles


def _derivatives(
    angles: Array, rest_turns: Array, spans: Array, pull: Array, clamp_angle: float
) -> tuple[Array, Array]:
    """Gradient (n,) and upper band (2, n) of the Hessian of a hanging strip's energy
    over EI [1/m] by its segment angles.
    """
    moment = (np.diff(angles, prepend=clamp_angle) - rest_turns) / spans
    gradient = moment + pull * np.cos(angles)
    gradient[:-1] -= moment[1:]
    stiffness = np.zeros((2, len(angles)))
    stiffness[1] = 1 / spans - pull * np.sin(angles)
    stiffness[1, :-1] += 1 / spans[1:]
    stiffness[0, 1:] = -1 / spans[1:]
    return gradient, stiffness
