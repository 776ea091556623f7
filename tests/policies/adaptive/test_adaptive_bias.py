"""Bias of the critic in folds through images: its terms, its fit, and the
checkpoint.
"""

from pathlib import Path

import numpy as np
import pytest

from drivers.base.errors import ConfigurationError
from policies.adaptive.checkpoint import (
    COMMITTED,
    THROUGH_IMAGES,
    about,
    load_bias,
    load_critic,
    save_critic,
)
from policies.adaptive.critic import (
    REFERENCE_THICKNESS,
    CriticBias,
    Untrained,
    bias_terms,
)
from policies.adaptive.train.transfer import FoldedBatch, fit_transfer

BIAS = np.array([0.7e-3, -1.0e-3, 0.5])


def folds(count: int, noise: float, wild: int = 0) -> FoldedBatch:
    """Folds of strips over the paper's range whose bias is BIAS."""
    rng = np.random.default_rng(5)
    length = np.log(0.02) + rng.uniform(-0.6, 0.6, count)
    thickness = rng.uniform(3e-4, 2e-3, count)
    displacement = rng.normal(0.0, 1e-3, count)
    predicted = (
        displacement + bias_terms(length, thickness - REFERENCE_THICKNESS) @ BIAS
    )
    predicted = predicted + noise * rng.standard_normal(count)
    predicted[:wild] += 0.02
    sigma = np.full(count, 5e-4)
    return FoldedBatch(displacement, predicted, sigma, length, thickness)


@pytest.mark.parametrize(("wild", "rms"), [(0, 2e-4), (3, 3.2e-3)])
def test_fit_finds_the_bias_beside_a_few_wild_folds(wild: int, rms: float) -> None:
    bias, quality = fit_transfer(folds(120, 2e-4, wild))
    assert (bias.always, bias.of_length, bias.of_thickness) == pytest.approx(
        BIAS, abs=3e-4, rel=0.2
    )
    assert quality.rms == pytest.approx(rms, rel=0.1)


def test_committed_weights_say_how_their_transfer_came_about() -> None:
    origin = about()[THROUGH_IMAGES]
    assert origin["left_out"]["folds"] >= 48
    assert origin["left_out"]["bias"] < 1e-3
    fitted = CriticBias.model_validate(origin["transfer"]["bias"])
    added = Untrained.shipped().added
    assert load_bias() == fitted.model_copy(update={"untrained": added})


@pytest.mark.parametrize(
    "facts",
    [
        {"bias": {"always": float("nan")}},
        {"bias": {"always": "much"}},
        ["not", "a", "mapping"],
    ],
)
def test_transfer_that_is_none_is_refused_in_one_line(
    facts: object, tmp_path: Path
) -> None:
    path = tmp_path / "odd.npz"
    save_critic(path, load_critic(COMMITTED), {THROUGH_IMAGES: {"transfer": facts}})
    with pytest.raises(
        ConfigurationError, match=r"odd\.npz: checkpoint is corrupt"
    ) as refused:
        load_bias(path)
    assert "\n" not in str(refused.value)
