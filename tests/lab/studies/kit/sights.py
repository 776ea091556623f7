"""Measures the images of a fold simulated on the chain, with the truth beside."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from calibration.calibration import Calibration
from cell.base.config.places import find_configs
from cell.perception.layer_touch import LayerTouch
from cell.perception.perception import Perception
from cell.perception.preflight import inspect
from cell.perception.strip_measurement import SeenTouch, StripMeasurement
from drivers.base.errors import PreflightRefused
from drivers.base.types import Array, Pose
from drivers.strip.file import StripFile
from policies.path import Path
from tests.lab.studies.kit.folds import cached_calibration
from tests.lab.studies.kit.twin_fold import FoldCamera, TwinFold, simulate_fold

TAKE_OVER = 0.10  # m of height from which a policy decides
BEFORE_TOUCH = 0.5  # s before the touch, from which on every image counts


@dataclass(frozen=True, slots=True)
class Sight:
    """Measurement of one image of `fold`: stamp [s], gripper pose, strip, and touch if
    seen.
    """

    stamp: float
    pose: Pose
    seen: StripMeasurement
    touch: SeenTouch | None
    fold: TwinFold

    @property
    def contact(self) -> float:
        """Error of the desk contact, measured minus true [m]."""
        return self.seen.contact_x - self.fold.contact_x(self.stamp)

    def profile(self) -> tuple[Array, Array]:
        """Signed distances (n,) [m] of measured points to the true curve, and shares
        (n,).
        """
        return signed_distances(self.seen.profile, self.fold.shape(self.stamp))


def fold_of(strip: str, path: Path, speed: float, links: int = 60) -> TwinFold:
    """Simulated fold of the strip called `strip` along `path` at `speed` [m/s]."""
    return simulate_fold(find_configs(None).strip(strip), path, speed, links=links)


def perception_of(
    camera: FoldCamera, strip: StripFile, calibration: Calibration
) -> Perception:
    """Perception of `strip` as it lies flat before `camera`; raises PreflightRefused
    where not.
    """
    found = inspect(camera.flat(strip), calibration, strip)
    if found.appearance is None:
        raise PreflightRefused(f"{strip.name}: the flat strip is not recognised")
    return Perception(calibration, strip, found.appearance)


def sights(
    fold: TwinFold,
    every: int = 1,
    twin: FoldCamera | None = None,
    calibration: Calibration | None = None,
) -> Iterator[Sight]:
    """Measure every `every`-th image from the take-over on, and all images near the
    touch.

    By the camera `twin`, or that of the configured cell. Ends once the touch is seen.
    Raises PreflightRefused where the flat strip is not recognised.
    """
    twin = twin or FoldCamera(fold.strip, find_configs(None).cell().twin.camera)
    camera = twin.settings
    perception = perception_of(twin, fold.strip, calibration or cached_calibration())
    detector = LayerTouch(fold.strip)
    near_touch = np.inf if fold.touch is None else fold.touch.time - BEFORE_TOUCH
    taken_over = float(fold.t[np.argmax(fold.poses[:, 1] >= TAKE_OVER)])
    for sequence in range(
        int(taken_over * camera.rate) + 1, int(fold.t[-1] * camera.rate)
    ):
        stamp = sequence / camera.rate
        if stamp < near_touch and sequence % every:
            continue
        pose = fold.pose(stamp)
        seen = perception.measure(twin.frame(fold, sequence), pose)
        touch = detector.update(seen, pose)
        yield Sight(stamp, pose, seen, touch, fold)
        if touch is not None:
            return


def signed_distances(points: Array, curve: Array) -> tuple[Array, Array]:
    """Distances (n,) of points (n, 2) from a polyline (m, 2), positive at its left,
    shares (n,).

    A share is the place of the nearest point of the curve, in segments over their
    number.
    """
    if not len(points):
        return np.zeros(0), np.zeros(0)
    start, along = curve[:-1], np.diff(curve, axis=0)
    offset = points[:, None] - start[None]
    share = np.clip((offset * along).sum(axis=2) / (along**2).sum(axis=1), 0, 1)
    gap = offset - share[..., None] * along
    nearest = np.hypot(gap[..., 0], gap[..., 1]).argmin(axis=1)
    rows = np.arange(len(points))
    normal = np.stack([-along[:, 1], along[:, 0]], axis=-1)[nearest]
    where = (nearest + share[rows, nearest]) / len(along)
    off = gap[rows, nearest]
    return np.copysign(np.hypot(*off.T), (off * normal).sum(axis=1)), where
