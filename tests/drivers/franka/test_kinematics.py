"""Geometry and inverse kinematics of the arm against published postures and finite
differences.
"""

import numpy as np
import pytest

from drivers.franka.inverse_kinematics import Unreachable, solve, twist_between
from drivers.franka.kinematics import HOME, forward, pose_and_jacobian
from drivers.franka.limits import FR3

DOWN = np.diag([1.0, -1.0, -1.0, 1.0])


def down_at(x: float, y: float, z: float):
    pose = DOWN.copy()
    pose[:3, 3] = x, y, z
    return pose


def postures(count: int):
    return np.random.default_rng(3).uniform(*FR3.ends, (count, 7))


def test_home_posture_points_down_where_the_maker_says() -> None:
    # libfranka's documentation of the start posture: x 0.307 m, z 0.487 m with the
    # Franka Hand
    assert forward(HOME) == pytest.approx(down_at(0.3069, 0.0, 0.4869), abs=1e-4)


def test_jacobian_is_the_derivative_of_the_pose() -> None:
    step = 1e-6
    for q in postures(5):
        numeric = [
            twist_between(forward(q - row), forward(q + row)) / (2 * step)
            for row in step * np.eye(7)
        ]
        assert pose_and_jacobian(q)[1] == pytest.approx(np.array(numeric).T, abs=1e-7)


def test_inverse_brings_tool_to_nearly_every_pose_of_the_arm() -> None:
    found = 0
    for target in forward(postures(20)):
        try:
            q = solve(target)
        except Unreachable:
            continue
        found += 1
        assert FR3.margins(q).min() >= 0
        assert forward(q) == pytest.approx(target, abs=1e-6)
    assert found >= 18


@pytest.mark.parametrize(
    ("pose", "said"),
    [
        (down_at(1.5, 0, 0.3), "from the shoulder"),
        (down_at(0.8, 0, 0.0), "are missing"),
        (down_at(np.nan, 0, 0.3), "not finite"),
    ],
)
def test_pose_out_of_reach_is_refused_with_its_reason(pose, said: str) -> None:
    with pytest.raises(Unreachable, match=said):
        solve(pose)
