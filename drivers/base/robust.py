"""Robust estimate of the standard deviation of errors with outliers."""

import numpy as np

from drivers.base.types import Array

MAD = 1.4826  # standard deviation of normal errors over their median absolute deviation


def robust_sigma(errors: Array) -> float:
    """Standard deviation of `errors` (n,) about zero, in their unit, by their median
    size.

    Consistent for normal errors; outliers hardly change it.
    """
    return MAD * float(np.median(np.abs(errors)))
