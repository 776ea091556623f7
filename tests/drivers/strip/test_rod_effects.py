"""Effects of mechanics in the rod: absent when null, seen when not, and as the laws say."""

from dataclasses import replace

import numpy as np
import pytest

from drivers.strip.effects import registry
from drivers.strip.effects.effect import Effect
from drivers.strip.model import StripModel
from drivers.strip.rod.engine import Rod
from drivers.types import Array
from policies.path import circular, triangular
from tests.support.rod_cases import for_all, paper_model, steady

DT = 0.005
LAWS = ("bending_hysteresis", "nonlinear_bending")
MECHANICAL = [registry()[name] for name in LAWS]
by_name = pytest.mark.parametrize("effect", MECHANICAL, ids=[e.name for e in MECHANICAL])


def _folds(models: list[StripModel], path: str = "triangular") -> tuple[Array, Array]:
    """Displacements (n,) [m] and contact_x (k, n) [m]."""
    way = {"triangular": triangular, "circular": circular}[path](0.6)
    rod = Rod(60)
    rod.reset(models)
    seen = rod.follow(for_all(steady(way, DT), len(models)), DT)
    gone = [np.nan if t is None else t.displacement for t in rod.touch]
    return np.array(gone), seen.contact_x


def _values(effect: Effect, share: float) -> dict[str, float]:
    """Parameters at `share` of their range."""
    return {p.name: p.low + share * (p.high - p.low) for p in effect.parameters}


@by_name
def test_effect_at_null_is_none_bit_for_bit(effect: Effect) -> None:
    switch = effect.parameters[0]
    if switch.null is None:
        pytest.skip("switched off by absence")
    null = {effect.name: {switch.name: switch.null}}
    _, contact = _folds([paper_model(0.1), paper_model(0.1, effects=null)])
    np.testing.assert_array_equal(contact[:, 0], contact[:, 1])


@by_name
@pytest.mark.parametrize("path", ["triangular", "circular"])
def test_effect_stays_finite_over_its_range_and_shows(effect: Effect, path: str) -> None:
    models = [
        paper_model(k, b, {effect.name: _values(effect, share)})
        for k in (0.02, 0.3)
        for b in (1.0, 50.0)
        for share in (0.0, 0.5, 1.0)
    ]
    bare = [paper_model(k, b) for k in (0.02, 0.3) for b in (1.0, 50.0)]
    displacement, _ = _folds(models, path)
    without, _ = _folds(bare, path)
    assert np.isfinite(displacement).all()
    moved = np.abs(displacement.reshape(4, 3) - without[:, None])
    assert (moved[:, 2] > 1e-4).all()


def test_friction_between_yarns_moves_the_displacement_as_measured() -> None:
    yarns = {"bending_hysteresis": {"yield_curvature": 12.0}}
    displacement, _ = _folds([paper_model(0.1), paper_model(0.1, effects=yarns)])
    assert displacement[1] - displacement[0] == pytest.approx(-0.014, abs=0.006)


def test_friction_between_yarns_separates_loading_from_unloading() -> None:
    yarns = {"bending_hysteresis": {"yield_curvature": 12.0}}
    middle, far = np.array([0.5, 0.12, np.pi / 2]), np.array([0.38, 0.2, np.pi / 2])
    away = middle + np.linspace(0.0, 1.0, 300)[:, None] * (far - middle)
    wait = np.repeat(middle[None], 400, axis=0)
    rod = Rod(60)
    rod.reset([paper_model(0.05, 20.0), paper_model(0.05, 20.0, yarns)], np.stack([middle] * 2))
    rod.advance(for_all(wait, 2), DT)
    there = rod.shapes()
    rod.advance(for_all(np.concatenate([away, away[::-1], wait]), 2), DT)
    apart = np.linalg.norm(rod.shapes() - there, axis=2).max(axis=1)
    assert apart[0] < 1e-4
    assert apart[1] > 4e-4


def test_seam_counts_where_it_is() -> None:
    bare = paper_model(0.1)
    models = [bare]
    for middle in (0.1, 0.3):
        rigidity = bare.mechanics.rigidity.copy()
        cells = (np.arange(len(rigidity)) + 0.5) / len(rigidity) * 0.6
        rigidity[np.abs(cells - middle) < 0.01] *= 5
        viscosity = bare.mechanics.viscosity * rigidity / bare.mechanics.rigidity
        mechanics = replace(bare.mechanics, rigidity=rigidity, viscosity=viscosity)
        models.append(replace(bare, mechanics=mechanics))
    displacement, _ = _folds(models)
    assert abs(displacement[1] - displacement[0]) < 0.001
    assert displacement[2] - displacement[0] < -0.010
