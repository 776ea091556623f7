"""A strip clamped at a ledge that hangs at rest under its own weight: the heavy elastica.

EI (theta' - kappa0)' = w (L - s) cos(theta), theta(0) = clamp angle, theta'(L) = kappa0(L), with
theta the tangent's angle above the horizontal and w the weight per length (Bickley 1934). The
strip is a chain of straight segments, finer at the ledge; its energy is convex while it hangs,
so Newton's method finds the one shape. Second order in the length of the segments.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, cholesky_banded, solveh_banded

from drivers.errors import CellError
from drivers.types import Array

SEGMENTS = 320
GRADING = 1.6  # arc = overhang t^GRADING at equal steps of t
ITERATIONS = 60
CONVERGED = 1e-10  # rad


class NoRest(CellError):
    """A hanging strip for which no shape at rest was found."""


@dataclass(frozen=True, slots=True)
class Hanging:
    """Equilibrium of a hanging strip: x, z [m] of `points` (n + 1, 2) from the ledge (0, 0), and
    `arc`.

    `angles` (n,) [rad] are those of the segments between them, above the horizontal; `stiffness`
    (2, n) is the upper band of the energy's second derivative over EI [1/m], `pull` (n,) [1/m] the
    moment of the weight over EI.
    """

    bending_length: float
    arc: Array
    angles: Array
    points: Array
    stiffness: Array
    pull: Array

    def moved_by_bending_length(self) -> Array:
        """Motion (n + 1, 2) [m] of the points per unit of ln(bending length)."""
        turn = solveh_banded(self.stiffness, 3 * self.pull * np.cos(self.angles))
        return self._motion(turn[:, None])[..., 0]

    def moved_by_clamp_angle(self) -> Array:
        """Motion (n + 1, 2) [m] of the points per radian of the clamp angle."""
        load = np.zeros(len(self.angles))
        load[0] = 1 / _spans(self.arc)[0]
        return self._motion(solveh_banded(self.stiffness, load)[:, None])[..., 0]

    def moved_by_rest_curvature(self, fields: Array) -> Array:
        """Motion (n + 1, 2, m) [m] per unit of rest curvature `fields` (n, m) [1/m].

        Field j holds at the hinge where segment j begins.
        """
        load = fields.copy()
        load[:-1] -= fields[1:]
        return self._motion(solveh_banded(self.stiffness, load))

    def _motion(self, turn: Array) -> Array:
        """Motion of the points (n + 1, 2, m) for turns of the segments (n, m) [rad]."""
        lengths = np.diff(self.arc)
        across = np.stack([-np.sin(self.angles), np.cos(self.angles)], axis=1) * lengths[:, None]
        steps = across[:, :, None] * turn[:, None, :]
        return np.concatenate([np.zeros((1, *steps.shape[1:])), np.cumsum(steps, axis=0)])


def segments(overhang: float) -> Array:
    """Arc lengths (n + 1,) [m] of the nodes from ledge to tip, finer at the ledge."""
    return np.asarray(overhang * np.linspace(0.0, 1.0, SEGMENTS + 1) ** GRADING)


def hinges(overhang: float) -> Array:
    """Arc lengths (n,) [m] of the hinges, at which a rest curvature is stated."""
    return segments(overhang)[:-1]


def hang(
    overhang: float,
    bending_length: float,
    *,
    rest_curvature: Array | None = None,
    clamp_angle: float = 0.0,
) -> Hanging:
    """The shape at rest of a strip of `bending_length` [m] that hangs over by `overhang` [m].

    `rest_curvature` (n,) [1/m] at the `hinges`, positive turns the free end up; `clamp_angle`
    [rad] above the horizontal. Raises NoRest when Newton's method finds no shape.
    """
    arc = segments(overhang)
    spans = _spans(arc)
    middle = 0.5 * (arc[1:] + arc[:-1])
    pull = np.diff(arc) * (overhang - middle) / bending_length**3
    born = np.zeros(len(pull)) if rest_curvature is None else rest_curvature * spans
    angles = _start_angles(middle, overhang, bending_length) + clamp_angle
    for _ in range(ITERATIONS):
        gradient, stiffness = _derivatives(angles, born, spans, pull, clamp_angle)
        step = _newton_step(gradient, stiffness, pull * np.sin(angles))
        angles = angles + step * min(1.0, 0.8 / max(float(np.abs(step).max()), 1e-300))
        if not np.abs(step).max() > CONVERGED:
            break
    if not (np.abs(step).max() <= CONVERGED and _stable(stiffness)):
        raise NoRest(
            f"a strip of bending length {bending_length:.4g} m over {overhang:.4g} m: "
            "no shape at rest was found"
        )
    across = np.stack([np.cos(angles), np.sin(angles)], axis=1) * np.diff(arc)[:, None]
    points = np.concatenate([np.zeros((1, 2)), np.cumsum(across, axis=0)])
    return Hanging(bending_length, arc, angles, points, stiffness, pull)


def _newton_step(gradient: Array, stiffness: Array, lifting: Array) -> Array:
    """Newton's step of the equilibrium, without the weight's stiffness where it destabilises."""
    if not _stable(stiffness):
        stiffness = stiffness + np.stack([np.zeros(len(lifting)), np.maximum(lifting, 0.0)])
    return np.asarray(-solveh_banded(stiffness, gradient))


def _stable(stiffness: Array) -> bool:
    """Whether the energy rises in all directions: the stiffness is positive definite."""
    try:
        cholesky_banded(stiffness, check_finite=False)
    except LinAlgError:
        return False
    return True


def _spans(arc: Array) -> Array:
    """Lengths (n,) [m] of strip that each hinge stands for: between the middles of the segments."""
    lengths = np.diff(arc)
    return np.asarray(0.5 * (lengths + np.concatenate([[0.0], lengths[:-1]])))


def _start_angles(arc: Array, overhang: float, bending_length: float) -> Array:
    """Starting angles of Newton's method: a bend at the ledge as wide as the weight allows."""
    reach = bending_length * min(1.0, (bending_length / overhang) ** 0.5)
    turned = -0.5 * np.pi * min(1.0, (overhang / bending_length) ** 3 / 8)
    return np.asarray(turned * (1 - np.exp(-arc / reach)))


def _derivatives(
    angles: Array, born: Array, spans: Array, pull: Array, clamp_angle: float
) -> tuple[Array, Array]:
    """First derivative (n,) and upper band (2, n) of the second derivative of the energy."""
    moment = (np.diff(angles, prepend=clamp_angle) - born) / spans
    gradient = moment + pull * np.cos(angles)
    gradient[:-1] -= moment[1:]
    stiffness = np.zeros((2, len(angles)))
    stiffness[1] = 1 / spans - pull * np.sin(angles)
    stiffness[1, :-1] += 1 / spans[1:]
    stiffness[0, 1:] = -1 / spans[1:]
    return gradient, stiffness
