"""Strips that nobody measured: the paper's range, yarn friction, and effects of textile size."""

from collections.abc import Callable, Mapping

import numpy as np

from drivers.strip.file import StripFile
from policies.domain import strip_at

LENGTH = 0.6  # m
THICKNESS = (0.0003, 0.002)  # m, log-uniform
DENSITY = (0.1, 0.5)  # kg/m^2, log-uniform: light shirting to heavy denim
RUBBING = 0.43  # share of strips with yarn friction
FRICTION = (2.0, 60.0)  # 1/m, yield curvature, log-uniform (KES tables hold 20 to 60)
RATIO = (5.0, 12.0)  # of pre-sliding over bending stiffness
OTHER = 0.25  # share of strips with one effect besides

Draw = Callable[[np.random.Generator, float], Mapping[str, float]]


def _stretch(rng: np.random.Generator, length: float) -> Mapping[str, float]:
    return {"stiffness": _log(rng, 6.0, 39.0)}


def _seam(rng: np.random.Generator, length: float) -> Mapping[str, float]:
    place, factor = rng.uniform(0.15, 0.95) * length, rng.uniform(1.5, 5.0)
    return {"factor": factor, "position": place, "width": 0.01}


def _nonlinear(rng: np.random.Generator, length: float) -> Mapping[str, float]:
    return {"cubic": _log(rng, 3e-5, 2e-4)}


def _gradient(rng: np.random.Generator, length: float) -> Mapping[str, float]:
    return {"slope": rng.uniform(-0.8, 0.8)}


def _drag(rng: np.random.Generator, length: float) -> Mapping[str, float]:
    return {"coefficient": rng.uniform(0.3, 1.5)}


def _curl(rng: np.random.Generator, length: float) -> Mapping[str, float]:
    return {"curvature": rng.uniform(-5.0, 5.0)}


def _crease(rng: np.random.Generator, length: float) -> Mapping[str, float]:
    return {"angle": rng.uniform(-0.3, 0.3), "position": rng.uniform(0.15, 0.95) * length}


def _hem(rng: np.random.Generator, length: float) -> Mapping[str, float]:
    mass = rng.uniform(0.02, 0.08) * 0.25 * 0.05 * length
    return {"mass": mass, "position": rng.uniform(0.3, 0.95) * length, "width": 0.01}


def _damping(rng: np.random.Generator, length: float) -> Mapping[str, float]:
    return {"coefficient": _log(rng, 1e-4, 1e-3)}


def _relaxation(rng: np.random.Generator, length: float) -> Mapping[str, float]:
    return {"ratio": rng.uniform(0.03, 0.2), "time": _log(rng, 0.1, 2.0)}


def _length(rng: np.random.Generator, length: float) -> Mapping[str, float]:
    return {"error": rng.uniform(-0.001, 0.002)}


EFFECTS: dict[str, Draw] = {
    "seam": _seam,
    "nonlinear_bending": _nonlinear,
    "stretch": _stretch,
    "stiffness_gradient": _gradient,
    "air_drag": _drag,
    "pre_curl": _curl,
    "crease": _crease,
    "hem_mass": _hem,
    "quadratic_damping": _damping,
    "relaxation": _relaxation,
    "length_error": _length,
}
"""Effects at the sizes that textiles have, drawn at random."""
OFTEN = {"seam": 3.0, "nonlinear_bending": 1.5}  # weights of the hard ones; others 1


def friction(rng: np.random.Generator, low: float, high: float) -> Mapping[str, float]:
    """Yarn friction, its yield curvature log-uniform over [`low`, `high`] [1/m]."""
    return {"yield_curvature": _log(rng, low, high), "stiffness_ratio": rng.uniform(*RATIO)}


def plain(
    rng: np.random.Generator, length: float = LENGTH, **effects: Mapping[str, float]
) -> StripFile:
    """A strip of the paper's range of `length` [m], textile weight, with these effects."""
    range_ = strip_at(rng.uniform(), rng.uniform())
    return StripFile(
        name="unknown",
        length=length,
        width=0.05,
        areal_density=_log(rng, *DENSITY),
        bending_length=range_.bending_length,
        retardation_time=range_.retardation_time,
        thickness=_log(rng, *THICKNESS),
        effects={name: dict(values) for name, values in effects.items()},
    )


def unknown(rng: np.random.Generator, length: float = LENGTH) -> StripFile:
    """A strip as it may come: friction on many, another effect on some."""
    effects: dict[str, Mapping[str, float]] = {}
    if rng.uniform() < RUBBING:
        effects["bending_hysteresis"] = friction(rng, *FRICTION)
    if rng.uniform() < OTHER:
        weights = np.array([OFTEN.get(name, 1.0) for name in EFFECTS])
        name = str(rng.choice(list(EFFECTS), p=weights / weights.sum()))
        effects[name] = EFFECTS[name](rng, length)
    return plain(rng, length, **effects)


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))
