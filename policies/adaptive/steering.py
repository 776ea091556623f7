"""Steering along a triangle of variable rise: up at 45 degrees, then down along z = x + rise."""

import math

import numpy as np
from numpy.typing import NDArray

from drivers.types import Array
from policies.policy import Decision

LOOK_AHEAD = 0.01  # m over which a cross-track error is steered out
LEAD = 0.04  # s of preview: half the time in which a gripper turns a corner
HIGHEST = 1 / 6  # of the length, largest rise
LEVELLING_HEIGHT = 0.02  # m of height, under which the gripper goes level
PAST = -0.15  # of the length, beyond which there is nothing left to fold
UP_DIRECTION, DOWN_DIRECTION, LEVEL_DIRECTION = 0.75 * math.pi, 1.25 * math.pi, math.pi


class Steering:
    """Steers n grippers along raised triangles; one that descends does not climb again."""

    def __init__(self, length: float, speed: float, count: int) -> None:
        """Steer `count` grippers over strips of `length` [m] at `speed` [m/s]."""
        self._length, self._speed = length, speed
        self.descending: NDArray[np.bool_] = np.zeros(count, dtype=bool)

    @property
    def highest(self) -> float:
        """Largest height [m] by which the line of descent may be raised."""
        return HIGHEST * self._length

    def decide(self, x: Array, z: Array, rise: Array) -> Decision:
        """Headings towards the lines z = x + `rise`, all (n,) [m]; done past the fixed edge."""
        above = (z - x - rise) / math.sqrt(2.0)
        self.descending = self.descending | (above > -self._speed * LEAD)
        turn = np.arctan2(above, LOOK_AHEAD)
        down = DOWN_DIRECTION + np.clip(turn, -math.pi / 4, math.pi / 4)
        direction = np.where(self.descending, down, UP_DIRECTION)
        direction = np.where(self.descending & (z < LEVELLING_HEIGHT), LEVEL_DIRECTION, direction)
        done = x < PAST * self._length
        speed = np.where(done, 0.0, self._speed)
        return Decision(direction, speed, np.zeros(len(x)), done)
