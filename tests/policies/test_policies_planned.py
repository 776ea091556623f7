"""The policy whose path is planned in the rod before the fold."""

import numpy as np
import pytest

from drivers.base.errors import ConfigurationError
from drivers.base.types import Array
from drivers.strip.describe import describe
from drivers.strip.file import StripFile
from drivers.strip.rod.engine import Rod
from drivers.twin.chain.engine import Chain
from policies.planned import Planned, plan
from policies.rollout import Rollout, roll_out
from policies.strip_sampling import grid, strip_at

pytestmark = pytest.mark.slow

STIFF_YARN = {"bending_hysteresis": {"yield_curvature": 12.0}}


def displacements(policy: Planned, strips: list[StripFile], engine: object) -> Array:
    models = [describe(strip) for strip in strips]
    rng = np.random.default_rng(0)
    return roll_out(
        policy, engine, strips[0], models, settings=Rollout(), rng=rng
    ).displacement


def test_known_strips_fold_within_a_millimetre_in_the_rod() -> None:
    strips = grid(4)
    d = displacements(Planned(strips), strips, Rod(100))
    assert np.abs(d).mean() < 0.0005
    assert np.abs(d).max() < 0.001


def test_plan_made_in_the_rod_holds_on_the_chain() -> None:
    strips = [
        strip_at(u, v) for u, v in ((0.0, 0.0), (0.2, 0.9), (0.6, 0.4), (1.0, 1.0))
    ]
    d = displacements(Planned(strips), strips, Chain(60))
    assert np.abs(d).mean() < 0.002
    assert np.abs(d).max() < 0.006


def test_plan_consumes_the_effects_of_the_strip() -> None:
    bare = strip_at(0.3, 0.3)
    real = bare.model_copy(update={"effects": STIFF_YARN})
    ignorant, knowing = Planned([bare]), Planned([real])
    engine = Rod(100)
    assert abs(displacements(ignorant, [real], engine)[0]) > 0.005
    assert abs(displacements(knowing, [real], engine)[0]) < 0.001


def test_strip_too_stiff_for_any_raised_triangle_is_refused_by_name() -> None:
    board = strip_at(1.0, 1.0).model_copy(
        update={"name": "board", "bending_length": 0.2, "retardation_time": 10.0}
    )
    with pytest.raises(ConfigurationError, match="board"):
        plan([board], 0.1)
