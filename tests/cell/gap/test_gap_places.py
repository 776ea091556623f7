"""Where an effect shows: in its places though none stands out by itself, and not in
noise.
"""

import numpy as np

from cell.gap.diagnosis.lack_of_fit import Repeats, ResidualTest, stronger_of_two
from cell.gap.fitting.gauss_newton import FitEstimate
from cell.gap.fitting.model import Model, Point
from cell.gap.subject.subject import FitRun, Samples, Series
from drivers.base.types import Array

PLACES, EACH, DRAWS = 20, 30, 400
SIZE = PLACES * EACH
FLAT: Array = np.ones(SIZE, dtype=np.float64)


def test_an_effect_is_told_in_its_places_where_none_stands_out_alone() -> None:
    rng = np.random.default_rng(2)
    effect = np.zeros(SIZE)
    effect[: 2 * EACH] = 0.7 * np.tile([1.0, -1.0], EACH)
    base = _estimate(effect + rng.standard_normal(SIZE))
    fitted = _estimate(np.concatenate(base.residuals) - effect)
    noise = rng.standard_normal((SIZE, DRAWS))
    test = ResidualTest(base, Repeats({}, {}), noise, FLAT)
    alone = test.test_bins()
    assert all(place.p > 0.05 for place in alone)
    told = test.matching(fitted, [])
    seen = {place.zone for place in stronger_of_two(alone, told) if place.p < 0.05}
    assert seen == {"zone 0", "zone 1"}


def test_the_best_of_many_models_of_noise_is_told_nowhere() -> None:
    rng = np.random.default_rng(3)
    noise = rng.standard_normal((SIZE, DRAWS))
    false = 0
    for _ in range(60):
        r = rng.standard_normal(SIZE)
        tried = [_fitted(r, rng.standard_normal(SIZE)) for _ in range(12)]
        best, *others = sorted(tried, key=lambda e: float(np.sum(e.residuals[0] ** 2)))
        told = ResidualTest(_estimate(r), Repeats({}, {}), noise, FLAT).matching(
            best, others
        )
        false += any(place.p < 0.05 for place in told)
    assert false <= 7


def _fitted(r: Array, direction: Array) -> FitEstimate:
    return _estimate(r - direction * (direction @ r) / (direction @ direction))


def _estimate(r: Array) -> FitEstimate:
    zones = np.repeat([f"zone {k}" for k in range(PLACES)], EACH)
    series = Series("profile", "profile", "lift", zones, FLAT, 1.0, 1.0, 0.0)
    runs = [FitRun("one", "slow", Samples.stack([series]))]
    nowhere = Point(np.zeros(0), (np.zeros(0),))
    return FitEstimate(Model(()), runs, nowhere, (r,), (), (np.zeros((SIZE, 0)),), 1.0)
