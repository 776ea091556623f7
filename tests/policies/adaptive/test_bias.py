"""What the critic is known to foresee wrongly, by the belief."""

from typing import Any

import numpy as np
import pytest

from policies.adaptive.bias import IN_ROD, LENGTH, THROUGH_IMAGES
from policies.adaptive.critic import Belief


def belief(length: float = 0.0) -> Belief:
    def told(mean: float) -> Any:
        return np.array([[mean, 0.1]])

    return Belief(told(LENGTH + length), told(-3.0), told(1.0))


def test_nothing_is_wrong_in_the_rod() -> None:
    assert IN_ROD.of(belief(0.3), 0.002) == pytest.approx([0.0])
    assert IN_ROD.sigma_of(np.array([5e-4]), None) == pytest.approx([5e-4])


def test_soft_and_thick_strips_fall_further_than_foreseen() -> None:
    usual, stiff = (float(THROUGH_IMAGES.of(belief(each), 0.001)[0]) for each in (0.0, 0.4))
    thick = float(THROUGH_IMAGES.of(belief(), 0.002)[0])
    assert usual == pytest.approx(THROUGH_IMAGES.always)
    assert stiff < usual < thick


def test_thickness_that_nobody_measured_widens_sigma() -> None:
    sigma = np.array([5e-4])
    known, unknown = (THROUGH_IMAGES.sigma_of(sigma, each)[0] for each in (0.001, None))
    assert unknown > 1.5 * known
    assert THROUGH_IMAGES.of(belief(0.5), None) == THROUGH_IMAGES.of(belief(0.5), 0.001)
