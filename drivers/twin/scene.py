"""What the twin's camera needs to know of the world at one instant."""

from dataclasses import dataclass

from drivers.types import Array, Pose


@dataclass(frozen=True, slots=True)
class Scene:
    """The world in the plane of the strip at `stamp` [s of the run], in the cell frame.

    `points` (n, 2) midline (x, z) [m] from the fixed edge on, `arc` (n,) its arc length [m];
    `gripper` the true pose of the fingers, `finger_width` the distance between them [m],
    `holds_strip` whether they hold the strip's edge, `pointer` whether they hold the pin of the
    calibration instead, `strip` whether a strip lies in the cell at all.
    """

    stamp: float
    points: Array
    arc: Array
    gripper: Pose
    finger_width: float
    holds_strip: bool
    pointer: bool = False
    strip: bool = True
