"""Obstacles of the arm: desk, clamp and floor; clearance of the hand, and joint paths
around.
"""

from collections.abc import Iterator, Sequence
from itertools import islice, pairwise

import numpy as np

from drivers.base.errors import Fault
from drivers.base.geometry import even_points, interpolate_columns
from drivers.base.installation import Installation
from drivers.base.types import Array, Pose, frozen
from drivers.franka.collision import Solids, self_clearance
from drivers.franka.failure import ArmFault, Cause
from drivers.franka.inverse_kinematics import straight
from drivers.franka.kinematics import HOME
from drivers.franka.limits import FR3, JointLimits
from drivers.franka.shapes import (
    CLAMP,
    FLANGE,
    NOTCH_LENGTH,
    PALM,
    block,
    boxes,
    desk_end,
    finger,
    side_view,
)

LEAVING = 1e-4  # m, tolerance for a hand that starts inside and must not go deeper
PATH_CHECKS = 200  # poses checked on a straight path: 5 mm apart at most in a workspace

# m of clearance of the arm, tracking errors and errors of the shapes included
ARM_CLEARANCE = 0.03
POSTURE_SPACING = 0.03  # rad at most between postures that are checked
CLEARANCE_TOLERANCE = 1e-3  # m, allowed approach where a path starts or ends too near
LEG_RISE = 0.05  # m of one upward leg
RISES = (0.1, 0.2, 0.3)  # m in all, to try
PATH_STEP = 0.005  # m
JOINT_ROOM = 0.03  # rad from a joint's end
SIDE_POINTS = 33  # points of a part's outline that are checked against the desk


def _points_of(outline: Array) -> Array:
    """Points (SIDE_POINTS, 2) [m] along the closed `outline` (m, 2) of a part of the
    hand.
    """
    return frozen(even_points(np.vstack([outline, outline[:1]]), SIDE_POINTS))


_SIDES = (
    np.vstack([_points_of(finger(0.0, side)) for side in (-1.0, 1.0)]),
    _points_of(block(PALM)),
    _points_of(block(FLANGE)),
)


def require_clear(path: list[Pose], end: float) -> None:
    """Raise Fault `hand_meets_desk` where the hand's `path` leads into a desk up to x =
    `end` [m].

    Poses are joined by straight lines; a hand that begins inside may leave.
    """
    corners = np.array([pose.as_array() for pose in path])
    times = np.linspace(0.0, len(path) - 1, PATH_CHECKS * (len(path) - 1) + 1)
    poses = interpolate_columns(times, np.arange(len(path), dtype=np.float64), corners)
    heights = desk_clearance(poses, end)
    deepest = int(np.argmin(heights))
    if heights[deepest] > min(0.0, heights[0] - LEAVING):
        return

    x, z, pitch = poses[deepest]
    raise Fault(
        "hand_meets_desk",
        f"the hand would come {-1e3 * heights[deepest]:.0f} mm into the desk at x"
        f" {1e3 * x:.0f}, z {1e3 * z:.0f} mm, pitch {np.degrees(pitch):.0f} deg: the"
        f" desk ends at x {1e3 * end:.0f} mm; move higher or further away, or correct"
        " installation.desk in cell.yaml",
    )


def desk_clearance(poses: Array, end: float) -> Array:
    """Height (n,) [m] above the desk of the hand's lowest point, at gripper poses (n,
    3) [m, rad].

    The desk reaches to x = `end` [m], less in the notch for the fingers; beside it the
    hand may be lower. Infinite where no part of the closed hand is above the desk.
    """
    fingers, palm, flange = _SIDES
    heights = [
        _height_over_desk(fingers, end - NOTCH_LENGTH, poses),
        _height_over_desk(palm, end, poses),
        _height_over_desk(flange, end, poses),
    ]
    lowest: Array = np.min(heights, axis=0)
    return lowest


def _height_over_desk(outline: Array, end: float, poses: Array) -> Array:
    """Height (n,) [m] of the lowest point of a part with `outline` (m, 2) over a desk
    up to x = `end` [m], at gripper `poses` (n, 3); infinite beside the desk.
    """
    along, height = np.moveaxis(side_view(outline, poses), -1, 0)
    over_desk = (along > CLAMP[0]) & (along < end)
    lowest: Array = np.where(over_desk, height, np.inf).min(axis=1)
    return lowest


def solids_of(installation: Installation) -> Solids:
    """Boxes of desk, clamp and floor, placed in the robot's base by the cell's
    mounting.
    """
    around = boxes(desk_end(installation))
    return Solids(installation.mounting.transform().matrix, around)


def floor_of(installation: Installation) -> Solids:
    """Box of the floor alone, placed in the robot's base by the cell's mounting."""
    *_, floor = boxes(desk_end(installation))
    return Solids(installation.mounting.transform().matrix, [floor])


def clear_path(
    start: Array, goal: Array, solids: Solids, limits: JointLimits = FR3
) -> list[Array]:
    """Joint waypoints (7,) [rad] from `start` (excluded) to `goal` on a path clear of
    all `solids`.

    A straight line in joint space where that is clear, else over points above start or
    goal, or over the upright posture. Raises ArmFault, naming the obstacle, where no
    path is clear.
    """
    objection = _objection([start, goal], solids)
    if not objection:
        return [goal]
    for points in _detours(start, goal, solids.frame[:3, 2], limits):
        if not _objection([start, *points, goal], solids):
            return [*points, goal]
    reason = (
        f"{objection}, and neither a way above nor one over the upright posture is"
        " clear"
    )
    raise ArmFault(Cause.BLOCKED, reason)


def _detours(
    start: Array, goal: Array, up: Array, limits: JointLimits
) -> Iterator[list[Array]]:
    """Yield detours of the arm between the joints `start` and `goal`, shortest first,
    as joint waypoints (7,) [rad].
    """
    ascents = [_joints_above(start, up, rise, limits) for rise in RISES]
    descents = [_joints_above(goal, up, rise, limits)[::-1] for rise in RISES]
    yield from ascents
    yield from descents
    yield from (
        [*rising, *sinking] for rising, sinking in zip(ascents, descents, strict=True)
    )
    yield [HOME]
    yield from ([*rising, HOME] for rising in ascents)
    for rising, sinking in zip(ascents, descents, strict=True):
        yield [*rising, HOME, *sinking]


def _joints_above(
    joints: Array, up: Array, rise: float, limits: JointLimits
) -> list[Array]:
    """Joints (7,) [rad] at every LEG_RISE metres straight along `up` (3,) until `rise`
    [m], as far as the arm reaches.
    """
    points = []
    steps = islice(straight(joints, PATH_STEP * up), round(rise / PATH_STEP))
    for step, posture in enumerate(steps, 1):
        if limits.margins(posture).min() < JOINT_ROOM:
            break
        if step % round(LEG_RISE / PATH_STEP) == 0:
            points.append(posture)
    return points


def _objection(points: Sequence[Array], solids: Solids) -> str:
    """Reason why straight joint motions through `points` (7,) [rad] collide; empty for
    none.
    """
    legs = []
    for start, end in pairwise(points):
        count = 2 + int(np.abs(end - start).max() / POSTURE_SPACING)
        legs.append(np.linspace(start, end, count))

    path = np.concatenate(legs)
    gaps = np.column_stack([self_clearance(path), solids.clearance(path)])
    names = ("itself", *(f"the {box.name}" for box in solids.boxes))

    for name, gap in zip(names, gaps.T, strict=True):
        if not _keeps_clear(gap):
            return f"the arm would come to {1e3 * gap.min():.0f} mm from {name}"

    return ""


def _keeps_clear(gap: Array) -> bool:
    """Whether distances (n,) [m] to an obstacle along a path stay above ARM_CLEARANCE.

    An arm that starts closer may move away, one that ends closer may approach.
    """
    clear = np.flatnonzero(gap >= ARM_CLEARANCE)
    if not len(clear):
        return False
    first = clear[0]
    last = clear[-1]
    leaves = (np.diff(gap[: first + 1]) > -CLEARANCE_TOLERANCE).all()
    approaches = (np.diff(gap[last:]) < CLEARANCE_TOLERANCE).all()
    return bool(
        leaves and approaches and (gap[first : last + 1] >= ARM_CLEARANCE).all()
    )
