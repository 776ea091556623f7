"""A strip that does not behave like the model is told from one that does."""

from functools import cache

import numpy as np
import pytest

from cell.perception.agreement import (
    BINS,
    FEWEST_IMAGES,
    Agreement,
    MeasuredFold,
    agreement,
    agreement_limits,
)
from drivers.strip.describe import describe
from drivers.strip.file import StripFile
from drivers.strip.rod.engine import Rod
from policies.path import triangular
from policies.prediction import Estimate, FoldPrediction
from policies.profile import profiles
from tests.support.effect_cases import simulate

STRIP = StripFile(
    name="unknown",
    length=0.6,
    width=0.05,
    areal_density=0.3,
    bending_length=0.019,
    retardation_time=0.06,
    thickness=0.001,
)


def about(value: float, spread: float) -> Estimate:
    return Estimate(value, value / spread, value * spread)


BELIEF = FoldPrediction(
    displacement=0.0,
    sigma=0.001,
    bending_length=about(0.019, 1.01),
    retardation_time=about(0.06, 1.3),
    yield_curvature=Estimate(0.5, 0.0, 1.0),
    blind=False,
)


@cache
def measured(**effects: tuple[tuple[str, float], ...]) -> MeasuredFold:
    """A fold of the strip with these effects, seen with the noise of images."""
    rng, path = np.random.default_rng(3), triangular(0.6, 0.04)
    t = np.arange(0.0, path.length / 0.1, 0.005)
    held = {name: dict(values) for name, values in effects.items()}
    model = describe(STRIP.model_copy(update={"effects": held}))
    rod = Rod(100)
    motion = simulate(rod, model, t, path.poses(0.1 * t), shapes=True)
    assert motion.touch is not None
    seen = slice(round(1.5 / 0.005), None, 3)
    arcs = np.broadcast_to(rod.arc()[0], (len(motion.t), rod.arc().shape[1]))
    curves = profiles(motion.shapes, arcs, motion.contact_x, motion.poses[:, :2])[seen]
    noise = rng.normal(size=curves.shape) * 0.0003 + rng.normal(size=(1, 1, 2)) * 0.0005
    return MeasuredFold.until(
        motion.touch.time, t, path.poses(0.1 * t), motion.t[seen], curves + noise
    )


def test_strip_of_the_models_law_agrees() -> None:
    found = agreement(STRIP, BELIEF, measured())
    assert found is not None
    assert found.like_model
    assert found.residual < 0.6 * agreement_limits().residual
    assert "behaves like the model" in found.sentence()


def test_noise_of_the_images_is_no_other_law() -> None:
    fold = measured()
    noise = 0.003 * np.random.default_rng(5).normal(size=fold.profile.shape)
    loud = fold._replace(profile=fold.profile + noise)
    assert loud.noise == pytest.approx(0.0013, rel=0.2)
    found = agreement(STRIP, BELIEF, loud)
    assert found is not None
    assert found.residual < agreement_limits().residual


def test_strip_of_another_law_is_flagged_and_the_sentence_names_what_to_do() -> None:
    another = measured(quadratic_damping=(("coefficient", 0.02),))
    found = agreement(STRIP, BELIEF, another)
    assert found is not None
    assert found.residual > agreement_limits().residual
    assert not found.like_model
    assert "does not behave like the model" in found.sentence()
    assert "`cell gap plan`" in found.sentence()


@pytest.mark.parametrize(
    ("residual", "friction", "says"),
    [
        (0.0, 0.0, "behaves like"),
        (0.01, 0.0, "is 10.8 mm off"),
        (0.0, 50.0, "rub as 112 1/m"),
    ],
)
def test_agreement_names_what_is_beyond_its_limit(residual, friction, says: str) -> None:
    most = agreement_limits()
    found = Agreement(most.residual + residual, most.yield_curvature + friction)
    assert found.like_model is not (residual + friction > 0.0)
    assert says in found.sentence()


@pytest.mark.parametrize("count", [0, BINS * FEWEST_IMAGES - 1])
def test_too_few_images_claim_nothing(count: int) -> None:
    fold = measured()
    few = fold._replace(stamp=fold.stamp[:count], profile=fold.profile[:count])
    assert agreement(STRIP, BELIEF, few) is None
