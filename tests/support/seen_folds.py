"""Accuracy of perception over simulated folds, for its tests."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calibration.calibration import Calibration
from cell.perception.strip_measurement import SeenTouch
from drivers.base.types import Array
from tests.lab.studies.kit.sights import sights, signed_distances
from tests.lab.studies.kit.twin_fold import FoldCamera, TwinFold

STRIPS = Path(__file__).parents[2] / "configs" / "strips"
SPEED = 0.1  # m/s


@dataclass(frozen=True)
class Agreement:
    """Errors against the truth [m] per frame: `t` (k,), `contact` (k,), `profile` (k,)
    rms normal to the true curve, `gap` (k,); the touch as seen and how much later it
    was told [s].
    """

    t: Array
    contact: Array
    profile: Array
    touch: SeenTouch | None
    told_after: float
    fold: TwinFold

    @property
    def lateness(self) -> float:
        """Time of the touch, seen minus true [s]."""
        return self.touch.time - self.fold.touch.time

    @property
    def displacement(self) -> float:
        """Error of the displacement at the touch, seen minus true [m]."""
        return self.touch.displacement - self.fold.touch.displacement


def distances(points: Array, curve: Array) -> Array:
    """Distance (n,) of points (n, 2) from a polyline (m, 2)."""
    return np.abs(signed_distances(points, curve)[0])


def agreement(
    fold: TwinFold, camera: FoldCamera, calibration: Calibration, *, every: int = 1
) -> Agreement:
    """Errors of perception over the frames of a fold, `every`-th one far from the
    touch.
    """
    rows, touch, told = [], None, float("nan")
    for sight in sights(fold, every, camera, calibration):
        stamp, points = sight.stamp, sight.seen.profile
        if sight.touch is not None:
            touch, told = sight.touch, stamp - fold.touch.time
            break
        off = (
            distances(points, fold.shape(stamp)) if len(points) else np.array([np.nan])
        )
        rows.append((stamp, sight.contact, float(np.sqrt(np.mean(off**2)))))
    t, contact, profile = np.array(rows).T
    return Agreement(t, contact, profile, touch, told, fold)


def rms(values: Array) -> float:
    """Root mean square of `values` (n,), NaN left out."""
    return float(np.sqrt(np.nanmean(np.square(values))))
