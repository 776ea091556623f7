"""Wait after a lift until gripper and strip are at rest, as far as the camera shows."""

from collections import deque

import numpy as np

from cell.orchestrator.lay import HANGING
from cell.orchestrator.recorder import Recorder
from cell.orchestrator.snapshot import Hold, Snapshot
from cell.orchestrator.steps import Motion, move, wait_for
from drivers.geometry import moving_average
from drivers.types import Array, Pose
from policies.profile import image_profile

COMPARED_TIME = 0.5  # s of images that are compared
FEWEST_IMAGES = 5  # of them
AVERAGED_IMAGES = 3  # images in a running mean, in which their noise averages out
REST_TRAVEL = 0.0005  # m that the profile's mean travels, below which a strip rests


def wait_until_still(longest: float, record: Recorder) -> Motion:
    """Bring the gripper to rest, upright, and wait at most `longest` [s] until the strip rests.

    The event `hanging` says whether the strip came to rest, and how far it still moved [m].
    """
    snapshot = yield from wait_for(lambda now: not now.arm.moving)
    place = snapshot.arm.commanded
    snapshot = yield from move(Pose(place.x, place.z, HANGING))
    start = snapshot.time
    swing = Swing()
    while not swing.still and snapshot.time - start < longest:
        snapshot = yield Hold()
        swing.add(snapshot, start)
    facts = {"waited": snapshot.time - start, "still": swing.still, "moved": swing.moved}
    record.event(snapshot.time, "hanging", **facts)
    return snapshot


class Swing:
    """Motion of a hanging strip: travel [m] of its profile's mean within COMPARED_TIME."""

    def __init__(self) -> None:
        self.moved = float("nan")
        self._means: deque[tuple[float, Array]] = deque()

    @property
    def still(self) -> bool:
        """Whether the strip has moved less than REST_TRAVEL over enough images."""
        return self.moved < REST_TRAVEL

    def add(self, snapshot: Snapshot, since: float) -> None:
        """Add the profile in `snapshot`, if it is new and from an image after `since` [s]."""
        measurement = snapshot.view.measurement
        if not snapshot.view.read or measurement is None or measurement.stamp < since:
            return
        mean = image_profile(measurement.profile, measurement.contact_x, measurement.gripper)[
            0
        ].mean(axis=0)
        if not np.isfinite(mean).all():
            return
        self._means.append((measurement.stamp, mean))
        while self._means[0][0] < measurement.stamp - COMPARED_TIME:
            self._means.popleft()
        enough = measurement.stamp - since >= COMPARED_TIME and len(self._means) >= FEWEST_IMAGES
        self.moved = self._travel() if enough else float("nan")

    def _travel(self) -> float:
        """Largest distance [m] of the profile's running mean from its mean over all images."""
        means = np.array([mean for _, mean in self._means])
        smooth = moving_average(means, AVERAGED_IMAGES)
        return float(np.hypot(*(smooth - means.mean(axis=0)).T).max())
