"""Motions by hand as the cell makes them."""

import numpy as np
import pytest

from drivers.base.errors import ConfigurationError
from policies.experiments.motion import human_motion
from policies.path import TAKEOVER_HEIGHT
from policies.registry import make_policy

LENGTH, MANY = 0.6, 20


def test_a_motion_goes_from_the_grasped_edge_over_the_fixed_one_and_rises_over_the_lift():
    for number in range(MANY):
        motion = human_motion(LENGTH, 3, number)
        np.testing.assert_allclose(motion.at(0.0), [LENGTH, 0.0], atol=1e-9)
        x, z = motion.at(motion.duration)
        assert -1e-3 < x < 0.05 * LENGTH
        assert 0.0 < z < 0.1 * LENGTH
        assert motion.path.points[:, 1].max() > 2 * TAKEOVER_HEIGHT
        assert motion.passing(TAKEOVER_HEIGHT) < motion.duration


def test_a_motion_by_hand_is_a_policy_by_its_name() -> None:
    assert make_policy("motion:by-hand-3-1").name == "motion:by-hand-3-1"
    for wrong in ("motion:by-hand", "motion:by-hand-3", "motion:by-hand-x-1"):
        with pytest.raises(ConfigurationError, match="by-hand-SEED-NUMBER"):
            make_policy(wrong)
