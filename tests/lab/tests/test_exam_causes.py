"""Hidden causes of the exam: nothing at their null, and in the chain what their laws
say.
"""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.base.readers import read_yaml
from drivers.base.types import Array
from drivers.strip.describe import describe
from drivers.strip.engine import StripMotion
from drivers.strip.model import Effects, StripModel
from drivers.twin.chain.engine import Chain
from policies.path import triangular
from tests.lab.exam.causes import cause_of, causes
from tests.lab.exam.causes.cause import Cause
from tests.lab.exam.from_state import Specimen
from tests.support.effect_cases import LENGTH, denim, simulate, way

LINKS, STEP = 40, 0.005
LATE = 6  # runs that a specimen has been through before
ALIKE: dict[str, dict[str, float]] = read_yaml(Path(__file__).with_suffix(".yaml"))
"""Values of the effect that each cause resembles; the first one is the cause's own as
well.
"""
LOADED: Effects = {
    "bending_hysteresis": {"yield_curvature": 2.0, "stiffness_ratio": 8.0},
    "relaxation": {"ratio": 0.2, "time": 0.5},
    "air_drag": {"coefficient": 1.5},
}


def described(effects: Effects | None = None, index: int = LATE) -> StripModel:
    return describe(denim(effects=effects or {}), index=index)


def moved(plant: Any, model: StripModel, seconds: float = 20.0) -> StripMotion:
    steady = way(triangular(LENGTH))
    within = steady.t <= seconds
    return simulate(
        plant, model, steady.t[within], steady.poses[within], dt=STEP, shapes=True
    )


def lifted(*causes: Cause, seconds: float = 3.0) -> Array:
    """The shape (n, 2) after a part of the fold."""
    return moved(Specimen(LINKS, causes, 5), described(), seconds).shapes[-1]


@pytest.fixture(scope="module")
def bare() -> StripMotion:
    return moved(Chain(LINKS), described())


@pytest.fixture(scope="module")
def half_way() -> Array:
    """The shape (n, 2) without a cause, after a part of the fold."""
    return lifted(seconds=4.5)


@pytest.mark.parametrize("effects", [{}, LOADED], ids=["bare", "loaded"])
def test_causes_at_null_leave_the_chain_bit_for_bit(effects: Effects) -> None:
    model = described(effects)
    expected = moved(Chain(LINKS), model, seconds=1.5)
    null = [
        cause_of(name, {cause.amount: cause.null}) for name, cause in causes().items()
    ]
    found = moved(Specimen(LINKS, null, 1), model, seconds=1.5)
    assert np.array_equal(found.shapes, expected.shapes)


@pytest.mark.slow
@pytest.mark.parametrize("name", ALIKE)
def test_cause_changes_a_fold_like_the_effect_that_it_resembles(
    name: str, bare: StripMotion
) -> None:
    effect, values = causes()[name].answers, ALIKE[name]
    assert effect is not None
    own = {causes()[name].amount: next(iter(values.values()))}
    changed = moved(Specimen(LINKS, [cause_of(name, own)], 5), described())
    library = moved(Chain(LINKS), described({effect: values}))
    last = min(len(m.t) for m in (bare, changed, library)) - 30
    cause, known = (
        (m.contact_x[270:last] - bare.contact_x[270:last]) for m in (changed, library)
    )
    cosine = cause @ known / math.sqrt((cause @ cause) * (known @ known))
    assert cosine > 0.75
    assert 0.4 < np.linalg.norm(cause) / np.linalg.norm(known) < 2.5
    assert not np.array_equal(cause, known)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    sorted({n for n, cause in causes().items() if cause.sizes} - {"clock_drift"}),
)
def test_a_strong_cause_moves_the_strip_and_the_same_seed_moves_it_alike(
    name: str, half_way: Array
) -> None:
    strong = cause_of(name, causes()[name].sizes["strong"])
    first, again = (lifted(strong, seconds=4.5) for _ in range(2))
    assert np.array_equal(first, again)
    assert np.abs(first - half_way).max() > 1e-4
