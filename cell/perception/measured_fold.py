"""Measured fold: the gripper's path and the profiles on it, averaged over time."""

from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from drivers.robust import MAD
from drivers.types import Array
from policies.profile import POINTS

BINS = 12  # of time, in which the noise of the images averages out
FEWEST_IMAGES = 3  # images in a bin that counts
TOUCH_MARGIN = 0.03  # s before the touch in which images do not count: the layers hide each other


class MeasuredFold(NamedTuple):
    """Measured gripper path and strip profiles of one fold.

    Gripper `poses` (m, 3) at times `t` (m,) [s] from the rest to the touch; `profile`
    (k, POINTS, 2) [m] at the stamps `stamp` (k,) [s], the take-over to just before the touch.
    """

    t: Array
    poses: Array
    stamp: Array
    profile: Array

    @classmethod
    def until(cls, touch: float, t: Array, poses: Array, stamp: Array, profile: Array) -> Self:
        """Measured fold up to the `touch` [s], from poses (m, 3) and profiles (k, POINTS, 2)."""
        seen = (stamp < touch - TOUCH_MARGIN) & np.isfinite(profile).all(axis=(1, 2))
        before = t <= touch
        return cls(t[before], poses[before], stamp[seen], profile[seen])

    @property
    def usable(self) -> bool:
        """Whether there are enough images for a comparison."""
        return len(self.t) > 1 and len(self.stamp) >= BINS * FEWEST_IMAGES

    def bin_curves(self, curves: Array) -> Array:
        """Robust average (BINS, POINTS, 2) of `curves` (k, POINTS, 2) in each bin; NaN where few.

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
        """Noise [m] of a point of `bin_curves`, root mean square along x and z together."""
        steps = np.abs(np.diff(self.profile, n=2, axis=0))  # what moves evenly leaves no trace
        sigma = MAD * np.median(steps, axis=0) / np.sqrt(6.0)  # variances of 1, -2, 1 add to 6
        variance_share = 0.5 * np.pi * BINS / len(self.stamp)  # of a median of a bin's images
        return float(np.sqrt(variance_share * (sigma**2).sum(axis=-1).mean()))

    @property
    def spacing(self) -> float:
        """Time [s] from one bin to the next."""
        return float(self.stamp[-1] - self.stamp[0]) / BINS

    def _bins(self) -> NDArray[np.intp]:
        share = (self.stamp - self.stamp[0]) / max(self.stamp[-1] - self.stamp[0], 1e-9)
        place: NDArray[np.intp] = np.minimum((BINS * share).astype(np.intp), BINS - 1)
        return place
