"""Resamples a measured gripper path at even times and smooths it, to drive the model."""

import numpy as np
from scipy.interpolate import CubicSpline

from drivers.types import Array, frozen

SMOOTHING_STEP = 0.005  # s between the points that are smoothed
DRIVING_STEP = 0.0025  # s between the points that drive the model
NARROWEST_HALF, WIDEST_HALF = 5, 20  # points on each side of the parabola that smooths
QUIET_NOISE = 5e-5  # m of noise up to which the narrow parabola serves


def smooth_path(t: Array, poses: Array, sigma: float) -> tuple[Array, Array]:
    """Times (k,) [s] and smooth poses (k, 3) of a path measured at `t` (m,) with noise `sigma` [m].

    A parabola through the points near each moment (Savitzky and Golay 1964); the more noise, the
    more points. A servo's limited jerk bends a path too little for the narrow one to blunt it.
    """
    even = np.arange(t[0], t[-1] + 0.5 * SMOOTHING_STEP, SMOOTHING_STEP)
    rough = np.stack([np.interp(even, t, poses[:, c]) for c in range(3)], axis=1)
    half = int(np.clip(NARROWEST_HALF * (sigma / QUIET_NOISE) ** 0.4, NARROWEST_HALF, WIDEST_HALF))
    half = min(half, (len(even) - 1) // 2)
    smooth = _parabolic_smoothing(rough, half) if half > 1 else rough
    fine = np.arange(even[0], even[-1] + 0.5 * DRIVING_STEP, DRIVING_STEP)
    return frozen(fine), frozen(CubicSpline(even, smooth)(fine))


def _parabolic_smoothing(values: Array, half: int) -> Array:
    """Smooth columns (k, c) by local parabolas through `half` neighbours a side (Savitzky-Golay).

    The first and last parabolas serve the ends, too. Importing scipy.signal would take a second.
    """
    powers = np.vander(np.arange(-half, half + 1.0), 3, increasing=True)
    through = np.linalg.pinv(powers)
    windows = np.lib.stride_tricks.sliding_window_view(values, len(powers), axis=0)
    ends = values[: len(powers)], values[-len(powers) :]
    first, last = (powers @ (through @ part) for part in ends)
    return np.concatenate([first[:half], windows @ through[0], last[half + 1 :]])
