"""Gripper positions at which the layers first touch in a level motion, as the paper
maps them.
"""

from itertools import product

import numpy as np
import pytest

from drivers.base.types import Array
from drivers.strip.describe import describe
from drivers.strip.rod.engine import Rod
from policies.path import Path
from policies.strip_sampling import strip_at

pytestmark = pytest.mark.slow

STEP = 0.005  # s
# m/s of the lift before, s of rest: three retardation times
LIFT_SPEED, DWELL_TIME = 0.1, 3.0
# mm, softest and stiffest
SLOW_X = {0.06: (437, 310), 0.14: (352, 223), 0.22: (268, 140)}


def touch_x(height: float, speed: float) -> Array:
    """Gripper x (2, 2) [mm] at the touch, for the range's ends of stiffness and
    damping.
    """
    strips = [strip_at(*corner) for corner in product((0.0, 1.0), repeat=2)]
    length, rise = strips[0].length, np.sqrt(2) * height
    path = Path.through(
        np.array([(length, 0.0), (length - height, height), (-0.15, height)])
    )
    up = np.arange(STEP, rise / LIFT_SPEED, STEP) * LIFT_SPEED
    rest = np.full(round(DWELL_TIME / STEP), rise)
    along = rise + np.arange(STEP, (path.length - rise) / speed, STEP) * speed
    poses = path.poses(np.concatenate([up, rest, along]))
    rod = Rod(100, strict=False)
    rod.reset([describe(strip) for strip in strips])
    touches = rod.advance(np.repeat(poses[:, None], len(strips), axis=1), STEP).touch
    ends = [np.nan if touch is None else touch.time for touch in touches]
    times = np.arange(1, len(poses) + 1) * STEP
    return 1e3 * np.interp(ends, times, poses[:, 0]).reshape(2, 2)


def test_critical_points_of_slow_strips_stand_where_two_other_simulations_put_them():
    found = [touch_x(height, 0.02)[:, 0] for height in SLOW_X]
    np.testing.assert_allclose(found, list(SLOW_X.values()), atol=8.0)


def test_damping_lets_the_gripper_go_further_before_layers_touch() -> None:
    slow, fast = touch_x(0.14, 0.02), touch_x(0.14, 0.1)
    assert np.all(slow[:, 1] < slow[:, 0])
    gone = fast[:, 0] - fast[:, 1]
    assert np.all((gone > 80) & (gone < 240))
