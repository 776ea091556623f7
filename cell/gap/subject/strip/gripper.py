"""The measured gripper path as the model is driven by it: even in time, its noise smoothed out."""

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import savgol_filter

from drivers.types import Array, frozen

EVEN = 0.005  # s between the points that are smoothed
FINE = 0.0025  # s between the points that drive the model
NARROW, WIDE = 5, 20  # points on each side of the parabola that smooths
QUIET = 5e-5  # m of noise up to which the narrow parabola serves


def smoothed(t: Array, poses: Array, sigma: float) -> tuple[Array, Array]:
    """Times (k,) [s] and poses (k, 3) of the path measured at `t` (m,) with noise `sigma` [m].

    A parabola through the points near each moment (Savitzky and Golay 1964); the more noise, the
    more points. A servo's limited jerk bends a path too little for the narrow one to blunt it.
    """
    even = np.arange(t[0], t[-1] + 0.5 * EVEN, EVEN)
    rough = np.stack([np.interp(even, t, poses[:, c]) for c in range(3)], axis=1)
    half = int(np.clip(NARROW * (sigma / QUIET) ** 0.4, NARROW, WIDE))
    half = min(half, (len(even) - 1) // 2)
    smooth = savgol_filter(rough, 2 * half + 1, 2, axis=0, mode="interp") if half > 1 else rough
    fine = np.arange(even[0], even[-1] + 0.5 * FINE, FINE)
    return frozen(fine), frozen(CubicSpline(even, smooth)(fine))
