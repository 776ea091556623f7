"""A policy that executes a predefined motion, whatever the images show."""

from collections.abc import Callable

import numpy as np

from drivers.strip.file import StripFile
from drivers.types import Array
from policies.experiments.motion import Motion
from policies.path import Path
from policies.policy import Decision, Observation

# s to either side over which the velocity of the motion is averaged: a gripper turns no sharp
# corner; cut off at both ends of the motion, where the speed fades in and out
HALF_SPAN = 0.03
GAIN = 4.0  # 1/s, of the feedback of the position error
FASTEST_COMMAND = 0.19  # m/s, limit of the commanded speed
SEARCH_SAMPLES = 2001  # points of a path among which the nearest is searched


class Scripted:
    """Executes the motion that `draw` returns for a strip's length [m] and a speed [m/s].

    The lift follows the motion's path; at the first decision the motion's clock is set to the
    gripper's position on it.
    """

    def __init__(self, name: str, draw: Callable[[float, float], Motion]) -> None:
        self.name = name
        self._draw = draw
        self._motion: Motion | None = None
        self._start_times: Array = np.zeros(0)

    def reset(self, strip: StripFile, speed: float, count: int) -> None:
        """Create the motion for `strip` and start at its beginning."""
        self._motion = self._draw(strip.length, speed)
        self._start_times = np.full(count, np.nan)

    def lift(self) -> Path:
        """Path of the lift, the motion's path."""
        return self._active_motion().path

    def decide(self, observation: Observation) -> Decision:
        """Headings and speeds that track the motion's present point; done at its end."""
        motion = self._active_motion()
        here = np.stack([observation.x, observation.z], axis=-1)
        if np.isnan(self._start_times).any():
            passed = [motion.passing(travel) for travel in _nearest_travel(motion.path, here)]
            self._start_times = observation.time - np.array(passed)
        now = observation.time - self._start_times
        place = motion.at(np.clip(now, 0.0, motion.duration))
        before = motion.at(np.clip(now - HALF_SPAN, 0.0, motion.duration))
        after = motion.at(np.clip(now + HALF_SPAN, 0.0, motion.duration))
        velocity = (after - before) / (2 * HALF_SPAN) + GAIN * (place - here)
        done = now >= motion.duration
        speed = np.where(done, 0.0, np.minimum(np.hypot(*velocity.T), FASTEST_COMMAND))
        direction = np.arctan2(velocity[:, 1], velocity[:, 0]) % (2 * np.pi)
        return Decision(direction, speed, np.zeros(len(here)), done)

    def _active_motion(self) -> Motion:
        if self._motion is None:
            raise RuntimeError(f"{self.name}: reset before the first decision")
        return self._motion


def _nearest_travel(path: Path, points: Array) -> Array:
    """Distances along `path` (n,) [m] of its points nearest to `points` (n, 2)."""
    travel = np.linspace(0.0, path.length, SEARCH_SAMPLES)
    away = np.linalg.norm(path.at(travel)[:, None] - points[None], axis=-1)
    return np.asarray(travel[np.argmin(away, axis=0)])
