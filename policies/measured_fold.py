"""A fold as it was measured: the gripper's path and the profiles on it, averaged over time."""

from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from drivers.types import Array
from policies.profile import POINTS

BINS = 12  # of time, in which the noise of the images averages out
FEWEST = 3  # images in a bin that counts
BEFORE = 0.03  # s before the touch in which images do not count: the layers hide each other


class MeasuredFold(NamedTuple):
    """Gripper `poses` (m, 3) at times `t` (m,) [s] from the rest to the touch; `profile`
    (k, POINTS, 2) [m] at the stamps `stamp` (k,) [s], the take-over to just before the touch.
    """

    t: Array
    poses: Array
    stamp: Array
    profile: Array

    @classmethod
    def until(cls, touch: float, t: Array, poses: Array, stamp: Array, profile: Array) -> Self:
        """What was measured before the `touch` [s], of poses at `t` and profiles at `stamp`."""
        seen = (stamp < touch - BEFORE) & np.isfinite(profile).all(axis=(1, 2))
        moved = t <= touch
        return cls(t[moved], poses[moved], stamp[seen], profile[seen])

    @property
    def usable(self) -> bool:
        """Whether there are enough images for a comparison."""
        return len(self.t) > 1 and len(self.stamp) >= BINS * FEWEST

    def binned(self, curves: Array) -> Array:
        """Medians (BINS, POINTS, 2) of `curves` (k, POINTS, 2) at the stamps; NaN where few."""
        place = self._bins()
        found = np.full((BINS, POINTS, 2), np.nan)
        for i in range(BINS):
            rows = curves[place == i]
            if len(rows) >= FEWEST:
                found[i] = np.median(rows, axis=0)
        return found

    @property
    def spacing(self) -> float:
        """Time from bin to bin [s]."""
        return float(self.stamp[-1] - self.stamp[0]) / BINS

    def _bins(self) -> NDArray[np.intp]:
        share = (self.stamp - self.stamp[0]) / max(self.stamp[-1] - self.stamp[0], 1e-9)
        place: NDArray[np.intp] = np.minimum((BINS * share).astype(np.intp), BINS - 1)
        return place
