"""Benchmark part: gripper position at the first touch, over height and fabric."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from cell.benchmark.results import CriticalPoints, finite_or_none
from drivers.strip.describe import describe
from drivers.strip.file import StripFile
from drivers.strip.rod.engine import Rod
from drivers.types import Array
from policies.domain import DAMPING_RATIO, strip_at
from policies.path import Path

STEP = 0.005  # s
SEGMENTS = 100
MOTION_COST = 0.002  # s, about, of a motion at 1 m/s
LIFT_SPEED = 0.1  # m/s, up to where the level motion begins
PATH_END = -0.15  # m, where the level motion ends
DWELL_TIME = 3.0  # s at rest before it: three times the slowest fabric's retardation


@dataclass(frozen=True, slots=True)
class Critical:
    """Benchmark part: level motions at `speed` [m/s] and each of `heights` [m], on many strips."""

    speed: float
    heights: tuple[float, ...]
    stiffnesses: int
    dampings: int
    of: str

    @property
    def key(self) -> str:
        """Key with all parameters of the part."""
        heights = ", ".join(f"{height:g}" for height in self.heights)
        counts = f"{self.stiffnesses} x {self.dampings}"
        return f"critical points at {self.speed} after rest over {counts}, heights {heights}"

    @property
    def cost(self) -> float:
        """Estimated time [s]."""
        return MOTION_COST * len(self.heights) * self.stiffnesses * self.dampings / self.speed

    def measure(self) -> CriticalPoints:
        """Find the gripper's x [m] at the layers' first touch, for every strip at every height."""
        u, v = np.linspace(0, 1, self.stiffnesses), np.linspace(0, 1, self.dampings)
        strips = [strip_at(a, b) for a, b in product(u, v)]
        found = [self._first_touch(height, strips).reshape(len(u), -1) for height in self.heights]
        return CriticalPoints(
            speed=self.speed,
            heights=self.heights,
            bending_lengths=tuple(strip_at(a, 0.0).bending_length for a in u),
            dampings=tuple(float(DAMPING_RATIO**b) for b in v),
            x=tuple(tuple(map(finite_or_none, rows)) for rows in found),
        )

    def _first_touch(self, height: float, strips: Sequence[StripFile]) -> Array:
        """Gripper x (n,) [m] at each strip's first touch, NaN without one."""
        length = strips[0].length
        poses = level_motion(length, height, self.speed)
        rod = Rod(SEGMENTS, strict=False)
        rod.reset([describe(strip) for strip in strips])
        touches = rod.advance(np.repeat(poses[:, None], len(strips), axis=1), STEP).touch
        times = np.arange(1, len(poses) + 1) * STEP
        ends = np.array([np.nan if touch is None else touch.time for touch in touches])
        return np.where(np.isfinite(ends), np.interp(ends, times, poses[:, 0]), np.nan)


def level_motion(length: float, height: float, speed: float) -> Array:
    """Poses (k, 3) every `STEP`: up the triangle's leg to `height`, a rest, level to `PATH_END`."""
    path = Path.through(np.array([(length, 0.0), (length - height, height), (PATH_END, height)]))
    rise = np.sqrt(2) * height
    up = np.arange(STEP, rise / LIFT_SPEED, STEP) * LIFT_SPEED
    rest = np.full(round(DWELL_TIME / STEP), rise)
    along = rise + np.arange(STEP, (path.length - rise) / speed, STEP) * speed
    return path.poses(np.concatenate([up, rest, along]))
