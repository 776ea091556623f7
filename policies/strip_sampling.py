"""Sampling of strips that policies are trained and judged on: paper's range, effects of
fabrics.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from drivers.base.readers import read_yaml
from drivers.base.types import Array
from drivers.strip.effects import registry
from drivers.strip.effects.effect import Span
from drivers.strip.file import StripFile, paper_damping_minimum, paper_strip

STIFFNESS_RANGE = (0.02, 0.3)  # N m/rad (paper, appendix)
# largest damping over the smallest at the same stiffness (paper, appendix)
DAMPING_RATIO = 50.0
STRIP_LENGTH = 0.6  # m
THICKNESS_RANGE = (0.0003, 0.002)  # m, log-uniform
DENSITY_RANGE = (0.1, 0.5)  # kg/m^2, log-uniform: light shirting to heavy denim
FRICTION_SHARE = 0.43  # share of strips with yarn friction
FRICTION_EFFECT = "bending_hysteresis"
OTHER_SHARE = 0.5  # share of strips with one further effect

EFFECTS = read_yaml(Path(__file__).with_suffix(".yaml"))
"""Effects besides friction with their relative frequencies."""
CONDITIONS = ("nothing", "friction", *EFFECTS)  # one effect at a time


def strip_at(u: float, v: float) -> StripFile:
    """Strip at (u, v) of the unit square: log stiffness and log damping in the
    published range.
    """
    low, high = STIFFNESS_RANGE
    k = low * (high / low) ** u
    return paper_strip(k, paper_damping_minimum(k) * DAMPING_RATIO**v)


def grid(n: int) -> list[StripFile]:
    """Strips on an n x n logarithmic grid of stiffness, then damping, in the published
    range.
    """
    fractions = np.linspace(0.0, 1.0, n)
    return [strip_at(u, v) for u in fractions for v in fractions]


def sample(n: int, rng: np.random.Generator) -> list[StripFile]:
    """Draw n x n strips of the published range by stratified sampling: one in each grid
    cell.
    """
    shift: Array = rng.uniform(size=(n, n, 2))
    cells = np.stack(np.meshgrid(np.arange(n), np.arange(n), indexing="ij"), axis=-1)
    fractions = ((cells + shift) / n).reshape(-1, 2)
    return [strip_at(u, v) for u, v in fractions]


def draw_friction(
    rng: np.random.Generator, low: float, high: float
) -> dict[str, float]:
    """Draw parameters of yarn friction, its yield curvature log-uniform in [low, high]
    [1/m].
    """
    ratio = registry()[FRICTION_EFFECT].textile["stiffness_ratio"]
    curvature = _log_uniform(rng, low, high)
    return {
        "yield_curvature": curvature,
        "stiffness_ratio": ratio.sample(rng, STRIP_LENGTH),
    }


def draw_effect(
    name: str, rng: np.random.Generator, length: float = STRIP_LENGTH
) -> dict[str, float]:
    """Draw parameters of the effect `name` within ranges for textiles, for a `length`
    [m].
    """
    return {
        key: span.sample(rng, length) for key, span in registry()[name].textile.items()
    }


def plain_strip(
    rng: np.random.Generator,
    length: float = STRIP_LENGTH,
    **effects: Mapping[str, float],
) -> StripFile:
    """Draw a strip of `length` [m] with `effects`, of published stiffness and damping
    ranges.
    """
    of_paper = strip_at(rng.uniform(), rng.uniform())
    return StripFile(
        name="unknown",
        length=length,
        width=0.05,
        areal_density=_log_uniform(rng, *DENSITY_RANGE),
        bending_length=of_paper.bending_length,
        retardation_time=of_paper.retardation_time,
        thickness=_log_uniform(rng, *THICKNESS_RANGE),
        effects={name: dict(values) for name, values in effects.items()},
    )


def strip_under_condition(
    condition: str, rng: np.random.Generator, length: float
) -> StripFile:
    """Draw a strip of `length` [m] with the effect that `condition`, one of CONDITIONS,
    names.
    """
    if condition == "nothing":
        return plain_strip(rng, length)
    name = FRICTION_EFFECT if condition == "friction" else condition
    return plain_strip(rng, length, **{name: draw_effect(name, rng, length)})


def random_strip(rng: np.random.Generator, length: float = STRIP_LENGTH) -> StripFile:
    """Draw a strip as operators may bring one: many have yarn friction, some another
    effect.
    """
    effects: dict[str, Mapping[str, float]] = {}
    if rng.uniform() < FRICTION_SHARE:
        effects[FRICTION_EFFECT] = draw_effect(FRICTION_EFFECT, rng, length)
    if rng.uniform() < OTHER_SHARE:
        frequencies = np.array([*EFFECTS.values()])
        name = str(rng.choice(list(EFFECTS), p=frequencies / frequencies.sum()))
        effects[name] = draw_effect(name, rng, length)
    return plain_strip(rng, length, **effects)


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return Span(low, high, log=True).sample(rng, STRIP_LENGTH)
