"""Strips that nobody measured: the paper's range, yarn friction, and effects of textile size."""

from collections.abc import Mapping
from typing import NamedTuple

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


class Span(NamedTuple):
    """Values from `low` to `high`, uniform or uniform in their logarithm; times the length."""

    low: float
    high: float
    log: bool = False
    of_length: bool = False

    def draw(self, rng: np.random.Generator, length: float) -> float:
        """A value, for a strip of `length` [m]."""
        if self.log:
            return float(np.exp(rng.uniform(np.log(self.low), np.log(self.high))))
        value = self.low if self.low == self.high else float(rng.uniform(self.low, self.high))
        return value * length if self.of_length else value


PLACE = Span(0.15, 0.95, of_length=True)
EFFECTS: dict[str, dict[str, Span]] = {
    "seam": {"position": PLACE, "factor": Span(1.5, 5.0), "width": Span(0.01, 0.01)},
    "nonlinear_bending": {"cubic": Span(3e-5, 2e-4, log=True)},
    "stretch": {"stiffness": Span(6.0, 39.0, log=True)},
    "stiffness_gradient": {"slope": Span(-0.8, 0.8)},
    "air_drag": {"coefficient": Span(0.3, 1.5)},
    "pre_curl": {"curvature": Span(-5.0, 5.0)},
    "crease": {"angle": Span(-0.3, 0.3), "position": PLACE},
    "hem_mass": {
        "mass": Span(2.5e-4, 1e-3, of_length=True),  # 2 to 8 % of a usual strip's
        "position": Span(0.3, 0.95, of_length=True),
        "width": Span(0.01, 0.01),
    },
    "quadratic_damping": {"coefficient": Span(1e-4, 1e-3, log=True)},
    "relaxation": {"ratio": Span(0.03, 0.2), "time": Span(0.1, 2.0, log=True)},
    "length_error": {"error": Span(-0.001, 0.002)},
}
"""Effects at the sizes that textiles have."""
OFTEN = {"seam": 3.0, "nonlinear_bending": 1.5}  # weights of the hard ones; others 1


def friction(rng: np.random.Generator, low: float, high: float) -> dict[str, float]:
    """Yarn friction, its yield curvature log-uniform over [`low`, `high`] [1/m]."""
    return {"yield_curvature": _log(rng, low, high), "stiffness_ratio": rng.uniform(*RATIO)}


def effect(name: str, rng: np.random.Generator, length: float = LENGTH) -> dict[str, float]:
    """The effect called `name` at a size drawn at random, on a strip of `length` [m]."""
    return {key: span.draw(rng, length) for key, span in EFFECTS[name].items()}


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
        effects[name] = effect(name, rng, length)
    return plain(rng, length, **effects)


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return Span(low, high, log=True).draw(rng, LENGTH)
