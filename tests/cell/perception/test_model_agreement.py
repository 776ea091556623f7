"""A strip that does not behave like the model is told from one that does."""

import numpy as np
import pytest

from cell.perception.model_agreement import (
    BINS,
    FEWEST_IMAGES,
    Agreement,
    AgreementLimits,
    agreement,
)
from tests.support.made_folds import BELIEF, STRIP, measured


def test_noise_of_the_images_is_no_other_law() -> None:
    fold = measured()
    noise = 0.003 * np.random.default_rng(5).normal(size=fold.profile.shape)
    loud = fold._replace(profile=fold.profile + noise)
    assert loud.noise == pytest.approx(0.0013, rel=0.2)
    found = agreement(STRIP, BELIEF, loud)
    assert found.residual < AgreementLimits.shipped().residual


@pytest.mark.parametrize(
    ("residual", "friction", "says"),
    [
        (0.0, 0.0, "behaves like"),
        (0.01, 0.0, "is 10.8 mm off"),
        (0.0, 50.0, "rub as 112 1/m"),
    ],
)
def test_agreement_names_what_is_beyond_its_limit(
    residual, friction, says: str
) -> None:
    most = AgreementLimits.shipped()
    found = Agreement(most.residual + residual, most.yield_curvature + friction)
    assert found.like_model is not (residual + friction > 0.0)
    assert says in found.sentence()


@pytest.mark.parametrize("count", [0, BINS * FEWEST_IMAGES - 1])
def test_too_few_images_claim_nothing(count: int) -> None:
    fold = measured()
    few = fold._replace(stamp=fold.stamp[:count], profile=fold.profile[:count])
    assert agreement(STRIP, BELIEF, few) is None
