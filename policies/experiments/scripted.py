"""Policy that executes a predefined motion, whatever the images show."""

from collections.abc import Callable

import numpy as np

from drivers.base.types import Array
from drivers.strip.file import StripFile
from policies.experiments.motion import Motion
from policies.path import Path
from policies.policy import Decision, Observation

# s to either side over which the velocity of the motion is averaged: a gripper turns no
# sharp corner; cut off at both ends of the motion, where the speed fades in and out
HALF_SPAN = 0.03
GAIN = 4.0  # 1/s, of the feedback of the position error
FASTEST_COMMAND = 0.19  # m/s, limit of the commanded speed
SEARCH_SAMPLES = 2001  # points of a path among which the nearest is searched


class Scripted:
    """Policy that executes the motion `draw(length, speed)` of a strip's length and a
    speed.

    The lift is along the motion's path; at the first decision the motion's clock is set
    to the gripper's position on it.
    """

    def __init__(self, name: str, draw: Callable[[float, float], Motion]) -> None:
        self.name = name
        self._draw = draw

    def reset(self, strip: StripFile, speed: float, count: int) -> None:
        """Create the motion for `strip` at `speed` [m/s], for `count` grippers at its
        start.
        """
        self._motion = self._draw(strip.length, speed)
        # NaN before the first decision
        self._start_times: Array = np.full(count, np.nan)

    def lift(self) -> Path:
        """Path of the lift: that of the motion."""
        return self._motion.path

    def decide(self, observation: Observation) -> Decision:
        """Command the motion's velocity with position feedback; done at the motion's
        end.
        """
        motion = self._motion
        points = np.stack([observation.x, observation.z], axis=-1)
        if np.isnan(self._start_times).any():
            self._start_times = observation.time - self._passed(points)
        elapsed = observation.time - self._start_times

        target = motion.at(np.clip(elapsed, 0.0, motion.duration))
        before = motion.at(np.clip(elapsed - HALF_SPAN, 0.0, motion.duration))
        after = motion.at(np.clip(elapsed + HALF_SPAN, 0.0, motion.duration))
        velocity = (after - before) / (2 * HALF_SPAN) + GAIN * (target - points)

        done = elapsed >= motion.duration
        speed = np.where(done, 0.0, np.minimum(np.hypot(*velocity.T), FASTEST_COMMAND))
        direction = np.arctan2(velocity[:, 1], velocity[:, 0]) % (2 * np.pi)
        return Decision(direction, speed, done)

    def _passed(self, points: Array) -> Array:
        """Times (n,) [s] at which the motion passes nearest to `points` (n, 2)."""
        path = self._motion.path
        travel = np.linspace(0.0, path.length, SEARCH_SAMPLES)
        gaps = np.linalg.norm(path.at(travel)[:, None] - points, axis=-1)
        nearest = travel[np.argmin(gaps, axis=0)]
        return np.array([self._motion.passing(s) for s in nearest])
