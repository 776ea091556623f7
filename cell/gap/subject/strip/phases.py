"""Names the phase of a fold at given times: lift, carry, hold, return or fall."""

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
SPEED_INTERVAL = 0.1  # s between the times of which the usual speed is taken
STANDING_SPEED = 0.01  # m/s up to which a gripper stands
GUESSED_SPEED = 0.1  # m/s, usual speed of a run that never moves
ZONES = ("fixed", "middle", "grasped")


def phases(run: Measured, t: Array) -> Words:
    """Phase of the fold (n,) at each of the times `t` (n,) [s]; the touch itself is none."""
    speed, back = _averaged_motion(run, t)
    usual = float(np.median(_moving_speeds(run)))
    lifted = run.t[np.argmax(run.poses[:, 1] >= TAKEOVER_HEIGHT)] if _is_rising(run) else run.end
    words = np.full(len(t), "carry", dtype="U8")
    words[back > RETURN_SPEED * usual] = "return"
    words[speed < HOLD_SPEED * usual] = "hold"
    if run.touch is not None:
        words[t > run.end - FALL] = "fall"
    words[t < lifted] = "lift"
    return words


def zones(s: Array, length: float) -> Words:
    """Third of a strip of `length` [m] (n,) that contains each of the arc lengths `s` (n,) [m]."""
    third = np.clip((3.0 * s / length).astype(np.int64), 0, 2)
    return np.array(ZONES)[third]


def _is_rising(run: Measured) -> bool:
    return bool((run.poses[:, 1] >= TAKEOVER_HEIGHT).any()) and not run.hanging


def _averaged_motion(run: Measured, t: Array) -> tuple[Array, Array]:
    """Speed (n,) [m/s] of the averaged motion at `t` (n,) [s], and its x component, backwards."""
    ends = [np.clip(t + side * AVERAGING_TIME / 2, run.t[0], run.t[-1]) for side in (-1, 1)]
    before, after = (
        np.stack([np.interp(e, run.t, run.poses[:, c]) for c in range(2)], axis=1) for e in ends
    )
    rate = (after - before) / np.maximum(ends[1] - ends[0], 1e-9)[:, None]
    return np.hypot(*rate.T), rate[:, 0]


def _moving_speeds(run: Measured) -> Array:
    """Speeds (k,) [m/s] of the averaged motion at the even times at which the gripper moves."""
    speeds, _ = _averaged_motion(run, np.arange(run.t[0], run.end, SPEED_INTERVAL))
    moving: NDArray[np.bool_] = speeds > STANDING_SPEED
    return speeds[moving] if moving.any() else np.array([GUESSED_SPEED])
