"""The transfer of the critic to folds through images: its fit, and its place in the checkpoint."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drivers.errors import ConfigurationError
from policies.adaptive.bias import THICKNESS, Bias, bias_terms
from policies.adaptive.checkpoint import (
    COMMITTED,
    THROUGH_IMAGES,
    about,
    load_critic,
    load_transfer,
    save_critic,
)
from policies.adaptive.roll import MOST, TERMS, Roll, roll_terms
from policies.adaptive.train.transfer import FoldedBatch, fit_transfer
from policies.adaptive.transfer import Transfer

BIAS = np.array([0.7e-3, -1.0e-3, 0.5])
ROLL = 1e-3 * np.array([3.0, -1.0, -4.0, -2.0, -0.8, 0.1, -1.2, -1.5, 0.7])


def folds(count: int, noise: float, wild: int = 0) -> FoldedBatch:
    """Folds of strips over the paper's range whose bias and roll are BIAS and ROLL."""
    rng = np.random.default_rng(5)
    length, time = (
        np.log(0.02) + rng.uniform(-0.6, 0.6, count),
        np.log(rng.uniform(0.01, 0.2, count)),
    )
    friction, thickness = rng.uniform(0.0, 2.0, count), rng.uniform(3e-4, 2e-3, count)
    displacement = rng.normal(0.0, 1e-3, count)
    rolled = np.clip(roll_terms(length, time, friction) @ ROLL, 0.0, MOST)
    predicted = displacement + bias_terms(length, thickness - THICKNESS) @ BIAS
    predicted = predicted + noise * rng.standard_normal(count)
    predicted[:wild] += 0.02
    edges = displacement + rolled + noise * rng.standard_normal(count)
    sigma = np.full(count, 5e-4)
    return FoldedBatch(displacement, edges, predicted, sigma, length, time, friction, thickness)


@pytest.mark.parametrize("wild", [0, 3])
def test_fit_finds_the_bias_and_the_roll_beside_a_few_wild_folds(wild: int) -> None:
    batch = folds(120, 2e-4, wild)
    transfer, quality = fit_transfer(batch)
    bias = transfer.bias
    assert (bias.always, bias.of_length, bias.of_thickness) == pytest.approx(
        BIAS, abs=3e-4, rel=0.2
    )
    expected = np.clip(roll_terms(*batch[4:7]) @ ROLL, 0.0, MOST)
    found = np.clip(roll_terms(*batch[4:7]) @ np.array(transfer.roll.weights), 0.0, MOST)
    assert np.abs(found - expected).max() < 1e-3
    assert quality.folds == 120
    assert quality.roll < 3e-4
    assert quality.within == pytest.approx(0.68, abs=0.05)


def test_sigma_grows_where_folds_scatter_by_more_than_was_stated() -> None:
    (little, _), (much, _) = fit_transfer(folds(120, 2e-4)), fit_transfer(folds(120, 1e-3))
    assert much.bias.sigma == pytest.approx(5.0 * little.bias.sigma, rel=0.3)


def test_fewer_folds_than_the_roll_has_terms_are_refused() -> None:
    with pytest.raises(ValueError, match=f"the fit needs {TERMS}"):
        fit_transfer(folds(TERMS - 1, 1e-4))


def test_committed_weights_say_how_their_transfer_came_about() -> None:
    origin = about()[THROUGH_IMAGES]
    assert origin["left_out"]["folds"] >= 48
    assert origin["left_out"]["bias"] < 1e-3
    assert load_transfer() == Transfer.read(origin["transfer"])


def test_checkpoint_from_the_rod_alone_corrects_nothing(tmp_path: Path) -> None:
    save_critic(tmp_path / "bare.npz", load_critic(), {"training": {}})
    assert load_transfer(tmp_path / "bare.npz") == Transfer()


@pytest.mark.parametrize(
    "facts",
    [
        {"roll": {"weights": [0.0] * (TERMS - 1)}},
        {"roll": {"weights": [float("nan")] * TERMS}},
        {"bias": {"always": float("inf")}},
        {"bias": {"always": "much"}},
        ["not", "a", "mapping"],
    ],
)
def test_transfer_that_is_none_is_refused_in_one_line(facts: object, tmp_path: Path) -> None:
    path = tmp_path / "odd.npz"
    save_critic(path, load_critic(COMMITTED), {THROUGH_IMAGES: {"transfer": facts}})
    with pytest.raises(ConfigurationError, match=r"odd\.npz: checkpoint is corrupt") as refused:
        load_transfer(path)
    assert "\n" not in str(refused.value)


def test_facts_are_read_back_as_they_were() -> None:
    transfer = Transfer(Bias(1e-3, 2e-3, 0.3, 1.1, 5e-4), replace(Roll(), weights=tuple(ROLL)))
    assert Transfer.read(json.loads(json.dumps(transfer.facts()))) == transfer
