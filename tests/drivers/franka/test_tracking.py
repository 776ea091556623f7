"""How the arm follows a pose from tick to tick."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.franka.kinematics import HOME, pose_and_jacobian
from drivers.franka.tracking import (
    INVERSE_DAMPING,
    joint_rates,
    joint_step,
    rotation,
)

ANGLES = [0.0, 1e-12, 1e-8, 1e-5, 0.3, 1.6, np.pi - 1e-3, np.pi - 1e-9]


@settings(max_examples=30, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**32 - 1))
def test_steps_follow_a_pose_and_keep_the_elbow(seed: int) -> None:
    random, q = np.random.default_rng(seed), np.array(HOME)
    target, jacobian = pose_and_jacobian(q)
    for _ in range(50):
        target = np.array(target)
        target[:3, 3] += 1e-4 * random.normal(size=3)
        target[:3, :3] = rotation(1e-4 * random.normal(size=3)) @ target[:3, :3]
        reached, jacobian = pose_and_jacobian(q)
        q = q + joint_step(q, reached, jacobian, target, HOME[2])
    assert pose_and_jacobian(q)[0] == pytest.approx(target, abs=1e-6)
    assert q[2] == pytest.approx(HOME[2], abs=1e-9)


def test_rates_stay_bounded_in_a_singular_posture() -> None:
    stretched = pose_and_jacobian(np.array([0, 0, 0, -0.47, 0, 0.55, 0.0]))[1]
    wanted = np.array([0.1, 0.1, 0.1, 0, 0, 0, 0])
    rates = joint_rates(stretched, wanted)
    assert np.linalg.norm(rates) <= np.linalg.norm(wanted) / (2 * INVERSE_DAMPING)
