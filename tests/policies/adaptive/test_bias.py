"""What the critic is known to foresee wrongly, by the belief."""

from typing import Any

import numpy as np
import pytest

from policies.adaptive.bias import REFERENCE_LOG_LENGTH, Bias, untrained_spread
from policies.adaptive.checkpoint import load_bias
from policies.adaptive.critic import Belief


def belief(length: float = 0.0) -> Belief:
    def told(mean: float) -> Any:
        return np.array([[mean, 0.1]])

    return Belief(told(REFERENCE_LOG_LENGTH + length), told(-3.0), told(1.0))


def test_nothing_is_wrong_in_the_rod() -> None:
    assert Bias().of(belief(0.3), 0.002) == pytest.approx([0.0])
    assert Bias().sigma_of(np.array([5e-4]), None) == pytest.approx([5e-4])


def test_bias_is_linear_in_the_logarithm_of_the_length_and_in_thickness() -> None:
    bias = Bias(always=1e-3, of_length=-2e-3, of_thickness=0.5)
    assert bias.of(belief(), 0.001) == pytest.approx([1e-3])
    assert bias.of(belief(0.4), 0.001) == pytest.approx([0.2e-3])
    assert bias.of(belief(), 0.002) == pytest.approx([1.5e-3])


def test_thickness_that_nobody_measured_widens_sigma() -> None:
    sigma, bias = np.array([5e-4]), Bias(of_thickness=0.5, sigma=1.2, unmeasured=6e-4)
    assert bias.sigma_of(sigma, 0.001) == pytest.approx([6e-4])
    assert bias.sigma_of(sigma, None) == pytest.approx([np.hypot(6e-4, 6e-4)])
    assert bias.of(belief(0.5), None) == bias.of(belief(0.5), 0.001)


def test_what_no_training_held_widens_sigma_through_images_but_not_in_the_rod() -> None:
    bias = Bias(sigma=0.8, unmeasured=3e-4, untrained=4e-4)
    assert bias.sigma_of(np.array([5e-4]), 0.001) == pytest.approx([np.hypot(4e-4, 4e-4)])
    assert load_bias().untrained == untrained_spread().added > 0.0
    assert Bias().untrained == 0.0
