"""Compensation of known camera and desk errors: the inverse effects applied to a calibration."""

import numpy as np

from calibration.calibration import Calibration, changed
from calibration.homography import Homography
from drivers.strip.model import Observation, StripModel
from drivers.strip.observation import true_points

AS_CALIBRATED = Observation()


def corrected(calibration: Calibration, model: StripModel) -> Calibration:
    """The calibration compensated for the effects of `model`, so that it gives true places.

    Corrects places, contact_x and stamps, all over the true desk. Without such effects the same
    object is returned; with some, a new calibration with its own id and without landmarks, which
    are valid only for the uncorrected one.
    """
    observation, plain = model.observation, AS_CALIBRATED
    if observation == plain and model.rig.desk_height == 0:
        return calibration
    return changed(
        calibration,
        homography=Homography.of(_truth_of(model) @ calibration.homography.matrix),
        landmarks=None,
        latency=calibration.latency + observation.camera_latency,
        contact_bias=calibration.contact_bias
        + observation.contact_bias / (1.0 + observation.scale),
    )


def _truth_of(model: StripModel) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """`true_points` as a matrix (3, 3) on homogeneous places."""
    origin, x, z = true_points(model, np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)]))
    return np.array([[*(x - origin), 0.0], [*(z - origin), 0.0], [*origin, 1.0]]).T
