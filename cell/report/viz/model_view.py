"""Simulation of the strip by its model, driven by the measured gripper, for display."""

import numpy as np

from drivers.errors import Fault, Unsupported
from drivers.strip.describe import describe
from drivers.strip.file import StripFile
from drivers.strip.rod.engine import Rod
from drivers.types import Array

STEP = 0.005  # s
TIME_ROUNDING = 1e-9  # s
SEGMENTS = 60
LONGEST_START, LONGEST_GAP = 10.0, 1.0  # s without a measured gripper, where the model ends
LIFTED_HEIGHT = 0.02  # m, above which a strip's first pose is one that hangs
NO_SHAPE = np.empty((0, 2))


class Shadow:
    """Rod simulated beside the real strip, from t = 0, where both lie flat or hang still."""

    def __init__(self, strip: StripFile) -> None:
        self._rod, self._model = Rod(SEGMENTS), describe(strip)
        self._steps = 0
        self._last: tuple[float, Array] | None = None
        try:
            self._rod.reset([self._model])
            self._lost = False
        except Unsupported:
            self._lost = True

    def follow(self, t: float, pose: Array) -> Array:
        """Midline (nodes, 2) [m] at the increasing time `t` [s], with the gripper at `pose` (3,).

        Empty once the model has diverged or the gripper was not measured for too long; the rest of
        the view goes on without it.
        """
        longest = LONGEST_START if self._last is None else LONGEST_GAP
        self._lost = self._lost or t > self._steps * STEP + longest
        if self._lost:
            return NO_SHAPE
        try:
            if self._last is None and pose[1] > LIFTED_HEIGHT:
                self._rod.reset([self._model], pose[None])
            last_t, last_pose = self._last or (t, pose)
            self._last = (t, pose)
            while (self._steps + 1) * STEP <= t + TIME_ROUNDING:
                self._steps += 1
                share = (self._steps * STEP - last_t) / max(t - last_t, STEP)
                between = last_pose + np.clip(share, 0.0, 1.0) * (pose - last_pose)
                self._rod.step(between[None], STEP)
        except Fault:
            self._lost = True
            return NO_SHAPE
        return np.asarray(self._rod.shapes()[0])
