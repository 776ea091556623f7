"""Measured fold: the gripper's path and the profiles on it, averaged over time."""

from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from drivers.types import Array
from policies.profile import POINTS

BINS = 12  # of time, in which the noise of the images averages out
FEWEST_IMAGES = 3  # images in a bin that counts
MAD = 1.4826  # sigma over the median of deviations
TOUCH_MARGIN = 0.03  # s before the touch in which images do not count: the layers hide each other


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
        """The measured fold before the `touch` [s], of poses at `t` and profiles at `stamp`."""
        seen = (stamp < touch - TOUCH_MARGIN) & np.isfinite(profile).all(axis=(1, 2))
        moved = t <= touch
        return cls(t[moved], poses[moved], stamp[seen], profile[seen])

    @property
    def usable(self) -> bool:
        """Whether there are enough images for a comparison."""
        return len(self.t) > 1 and len(self.stamp) >= BINS * FEWEST_IMAGES

    def bin_curves(self, curves: Array) -> Array:
        """`curves` (k, POINTS, 2) in the middle of each bin (BINS, POINTS, 2); NaN where few.

        Medians of what the bin's images show besides an even motion: a median of what moves rests
        on the few images in its middle.
        """
        place = self._bins()
        found = np.full((BINS, POINTS, 2), np.nan)
        for i in range(BINS):
            rows, t = curves[place == i], self.stamp[place == i]
            if len(rows) >= FEWEST_IMAGES:
                t = t - t.mean()
                rate = np.tensordot(t, rows, axes=1) / (t @ t)
                found[i] = np.median(rows - t[:, None, None] * rate, axis=0)
        return found

    @property
    def noise(self) -> float:
        """Noise [m] that is left in a point of `bin_curves`, along x and z together, rms."""
        steps = np.abs(np.diff(self.profile, n=2, axis=0))  # what moves evenly leaves no trace
        sigma = MAD * np.median(steps, axis=0) / np.sqrt(6.0)
        of_median = 0.5 * np.pi * BINS / len(self.stamp)
        return float(np.sqrt(of_median * (sigma**2).sum(axis=-1).mean()))

    @property
    def spacing(self) -> float:
        """Time from bin to bin [s]."""
        return float(self.stamp[-1] - self.stamp[0]) / BINS

    def _bins(self) -> NDArray[np.intp]:
        share = (self.stamp - self.stamp[0]) / max(self.stamp[-1] - self.stamp[0], 1e-9)
        place: NDArray[np.intp] = np.minimum((BINS * share).astype(np.intp), BINS - 1)
        return place
