"""Conversion between true and measured values: gripper poses, image points, forces and
times.

True poses and points are over the true desk, as engines have them; reported and
measured ones are in the cell frame of the calibration. measured = (1 + scale) true +
shift; times are stamps.

The strip is grasped as it lies on the desk, so offsets, tilt and desk height act from 0
upwards over the first `LIFT_TRAVEL` of the path, in proportion to the largest distance
from its start. A strip that already hangs at the start of the path has the full
offsets.
"""

from dataclasses import replace
from typing import TypeVar

import numpy as np

from drivers.base.geometry import interpolate_columns
from drivers.base.types import Array
from drivers.strip.engine import Touch
from drivers.strip.model import ObservationModel, Rig, StripModel

Number = TypeVar("Number", float, Array)
LIFT_TRAVEL = 0.10  # m of path over which a lift turns the pitch from flat to hanging
AS_REPORTED = Rig()
FORCE_WINDOW = 0.02  # s over which an arm averages a force; assumed
SHORTEST_WINDOW = 1e-9  # s, keeps the mean of a path of one row finite


def true_path(
    rig: Rig, t: Array, poses: Array, *, hanging: bool = False
) -> tuple[Array, Array]:
    """True times (m,) [s] and gripper poses (m, 3) [m, m, rad] for the times `t` (m,)
    and `poses` (m, 3) that an arm reported.

    `hanging`: the strip hangs when the path begins. Without effects of the rig the
    arrays are returned unchanged.
    """
    if rig == AS_REPORTED:
        return t, poses
    growth = np.maximum.accumulate(_fraction_away(poses, poses[0]))
    return t - rig.delay, true_poses(
        rig, poses, np.ones(len(poses)) if hanging else growth
    )


def _fraction_away(poses: Array, start: Array) -> Array:
    """Fraction (...,), from 0 to 1, of the rig's pose offsets that acts at reported
    gripper `poses` (..., 3) [m, m, rad].

    It grows with the distance from `start` (3,), the pose of the grasp.
    """
    away = np.hypot(poses[..., 0] - start[0], poses[..., 1] - start[1])
    fraction: Array = np.minimum(away / LIFT_TRAVEL, 1.0)
    return fraction


def true_poses(rig: Rig, reported: Array, fraction: Array | float) -> Array:
    """True gripper poses (..., 3) [m, m, rad] for `reported` ones (..., 3), with a
    `fraction` of the rig's offsets added.
    """
    return reported + np.multiply.outer(fraction, _offset(rig))


class GrowingOffsets:
    """Pose offsets of a `rig` that grow from 0 to their full size as the gripper moves
    away from where it grasped.

    `start` (3,) is the reported pose of the grasp, None before it; `fraction` of the
    offsets acts.
    """

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        self.start: Array | None = None
        self.fraction = 0.0

    def advance(self, reported: Array) -> Array:
        """True pose (3,) [m, m, rad] of a gripper that has moved to the pose `reported`
        (3,).
        """
        if self.start is not None:
            away = float(_fraction_away(reported, self.start))
            self.fraction = max(self.fraction, away)
        return self.true(reported)

    def true(self, reported: Array) -> Array:
        """True pose (3,) [m, m, rad] of a gripper reported at `reported` (3,), with the
        fraction of the offsets reached so far.
        """
        return true_poses(self._rig, reported, self.fraction)


def reported_poses(rig: Rig, true: Array, fraction: Array | float) -> Array:
    """Gripper poses (..., 3) [m, m, rad] that an arm reports for `true` ones (..., 3),
    with a `fraction` of the rig's offsets removed.
    """
    return true - np.multiply.outer(fraction, _offset(rig))


def _offset(rig: Rig) -> Array:
    """Offset (3,) [m, m, rad] from the reported to the true gripper pose, heights being
    above the true desk.
    """
    return np.array([rig.grip_x, rig.grip_z - rig.desk_height, rig.grip_tilt])


def image_stamp(observation: ObservationModel, t: Number) -> Number:
    """Time stamp (...,) [s] of an image that shows the strip as it was at true time `t`
    (...,) [s].
    """
    return t + observation.camera_latency


def imaged_time(observation: ObservationModel, stamp: Number) -> Number:
    """True time (...,) [s] at which the strip was as an image with the time stamp
    `stamp` (...,) [s] shows it.
    """
    return stamp - observation.camera_latency


def measured_points(model: StripModel, points: Array) -> Array:
    """Points (..., 2) [m] at which the camera measures true `points` (..., 2) [m] of a
    midline.
    """
    raised = points + np.array([0.0, model.rig.desk_height])
    measured: Array = (1 + model.observation.scale) * raised + _shift(model.observation)
    return measured


def true_points(model: StripModel, points: Array) -> Array:
    """True points (..., 2) [m] of a midline that the camera measures at `points` (...,
    2) [m].
    """
    raised = (points - _shift(model.observation)) / (1 + model.observation.scale)
    true: Array = raised - np.array([0.0, model.rig.desk_height])
    return true


def measured_contact(observation: ObservationModel, x: Number) -> Number:
    """Desk contact x (...,) [m] that the camera measures where the true one is `x`
    (...,) [m].
    """
    return (1 + observation.scale) * x + (
        observation.shift_x + observation.contact_bias
    )


def mean_force(t: Array, force: Array) -> Array:
    """Moving average (k, 2) [N] over FORCE_WINDOW seconds of `force` (k, 2) [N] at
    times `t` (k,) [s].

    Between the rows of a recorded path a simulated gripper jerks, as a real arm does
    not.
    """
    from scipy.integrate import cumulative_trapezoid  # a second that no fold needs

    total = cumulative_trapezoid(force, t, axis=0, initial=0.0)
    ends = [np.clip(t + side * FORCE_WINDOW / 2, t[0], t[-1]) for side in (-1, 1)]
    first, last = (interpolate_columns(end, t, total) for end in ends)
    return (last - first) / np.maximum(ends[1] - ends[0], SHORTEST_WINDOW)[:, None]


def reported_force(
    observation: ObservationModel, t: Array, true_t: Array, force: Array
) -> Array:
    """Force (m, 2) [N] that the sensor reports at times `t` (m,) [s], for a true
    `force` (k, 2) [N] at times `true_t` (k,) [s].
    """
    then = t - observation.force_delay
    offset = np.array([observation.force_x, observation.force_z])
    reported: Array = interpolate_columns(then, true_t, force) + offset
    return reported


def measured_touch(
    model: StripModel, touch: Touch, grip: Array, reported: Array
) -> Touch:
    """Layer touch as the camera measures the true `touch`.

    `grip` (3,) is the true gripper pose at the touch, `reported` (3,) the arm's at the
    image's stamp. l1 is measured along the image of the upper layer to the reported
    grip point, along the strip's end tangent; l2 to the stated position of the fixed
    edge, x = 0.
    """
    x = float(measured_points(model, np.array([touch.x, 0.0]))[0])
    end = np.array([np.cos(grip[2]), np.sin(grip[2])])
    missed = float((reported[:2] - measured_points(model, grip[:2])) @ end)
    return replace(
        touch,
        time=image_stamp(model.observation, touch.time),
        x=x,
        to_grasped=(1 + model.observation.scale) * (touch.to_grasped + touch.extension)
        + missed,
        to_fixed=x,
        extension=0.0,
    )


def _shift(observation: ObservationModel) -> Array:
    return np.array([observation.shift_x, observation.shift_z])
