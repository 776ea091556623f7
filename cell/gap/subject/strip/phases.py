"""Phases of a gripper's motion over time, named by the stages of a fold."""

import numpy as np
from numpy.typing import NDArray

from cell.gap.subject.strip.runs import Measured
from cell.gap.subject.subject import Words
from drivers.types import Array
from policies.path import TAKEOVER_HEIGHT

FALL = 1.0  # s before the touch in which the fold comes down
AVERAGING_TIME = 0.6  # s over which the gripper's own motion is averaged: shakes are no motion
HOLD_SPEED = 0.25  # of the run's usual speed, below which the gripper holds
RETURN_SPEED = 0.3  # of the run's usual speed at which it moves towards the lift's side
ZONES = ("fixed", "middle", "grasped")


def phases(run: Measured, t: Array) -> Words:
    """Phase (n,) at each of the times `t` (n,) [s]; the touch itself is no stretch of time."""
    speed, back = _averaged_motion(run, t)
    usual = max(float(np.median(_moving_speed(run))), 1e-3)
    lifted = run.t[np.argmax(run.poses[:, 1] >= TAKEOVER_HEIGHT)] if _is_rising(run) else run.end
    words = np.full(len(t), "carry", dtype="U8")
    words[back > RETURN_SPEED * usual] = "return"
    words[speed < HOLD_SPEED * usual] = "hold"
    if run.touch is not None:
        words[t > run.end - FALL] = "fall"
    words[t < lifted] = "lift"
    return words


def zones(s: Array, length: float) -> Words:
    """Thirds of the strip (n,) that contain the arc lengths `s` (n,) [m]."""
    third = np.clip((3.0 * s / length).astype(np.int64), 0, 2)
    return np.array(ZONES)[third]


def _is_rising(run: Measured) -> bool:
    return bool((run.poses[:, 1] >= TAKEOVER_HEIGHT).any()) and not run.hanging


def _averaged_motion(run: Measured, t: Array) -> tuple[Array, Array]:
    """Speed of the averaged motion, and its backward component (n,) [m/s]."""
    ends = [np.clip(t + side * AVERAGING_TIME / 2, run.t[0], run.t[-1]) for side in (-1, 1)]
    there, here = (
        np.stack([np.interp(e, run.t, run.poses[:, c]) for c in range(2)], axis=1)
        for e in reversed(ends)
    )
    rate = (there - here) / np.maximum(ends[1] - ends[0], 1e-9)[:, None]
    return np.hypot(*rate.T), rate[:, 0]


def _moving_speed(run: Measured) -> Array:
    """Speed of the averaged motion at even times while it moves (k,) [m/s]."""
    every = _averaged_motion(run, np.arange(run.t[0], run.end, 0.1))[0]
    moving: NDArray[np.bool_] = every > 0.01
    return every[moving] if moving.any() else np.array([0.1])
