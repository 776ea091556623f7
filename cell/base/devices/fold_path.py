"""Waypoints of the gripper in a fold, from its home to the retreat, and the path
through them.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from cell.base.config.settings import FoldSettings
from drivers.base.geometry import arc_lengths, lengths
from drivers.base.installation import Installation, MotionLimits
from drivers.base.types import Array, Pose
from drivers.franka.shapes import ROOM, TIP_AHEAD
from drivers.strip.engine import Touch
from policies.path import Path, lift_pitch

HANGING = np.pi / 2  # rad, pitch of a gripper from which the strip hangs straight down
LAYERS = 0.002  # m of fabric that are planned under the fingers' ends
# m by which an edge that has come down would lie beyond its grip, let go: mean, and rms
# over the ten strips
BEND, BENDING = 0.0036, 0.0017
PUSH = 0.03  # m by which an edge is pushed at most, once it is down
LOOSE = 0.004  # m between the fingers when they have let go of a laid edge
PULL = 0.01  # m by which an upper layer that is too short is pulled along at most
NEAR_EDGE = 0.05  # m beside and above the other edge, where a plain fold ends
LEG_POINTS = 30  # points of either leg of a plain fold
POINT_SPACING = 0.01  # m between points of a carried strip's path that are kept
# m of a path over which an arm may round a corner: 9 mm inside a right angle
CORNER = 0.05
TURNING = 2.4  # rad/s, rotation of the hand in a fold, a little below an arm's limit
# least derivative of a path counted, so that no limit is divided by 0
LEAST_NEED = 1e-9


def whole_path(
    length: float,
    installation: Installation,
    fold: FoldSettings,
    carry: Array,
    touch: Touch | None = None,
    goal: float = 0.0,
) -> tuple[Array, Array]:
    """Waypoints of the gripper in a fold: poses (n, 3), x, z [m] and pitch [rad], and
    speeds (n,) [m/s] of the moves to each.

    From the home over the edge of a strip of `length` [m]; `carry` (k, 2) leads from
    the grasped edge to where the layers touch. Lay and retreat follow, after this
    `touch` of the layers, or without one as where the strip hangs straight down, and
    end at x = `goal` [m].
    """
    home = Pose(length, installation.home_height, 0.0)
    approach = [pose.as_array() for pose in (home, *approach_poses(length, fold))]

    carry = _thin_out(carry)
    carried = np.column_stack([carry, lift_pitch(arc_lengths(carry))])[1:]

    x, z = carry[-1].tolist()
    taut = max(x - z, 0.0) if touch is None else taut_edge(touch)
    plan = lay_plan(
        gripper=Pose(x, z, HANGING), taut=taut, layers=LAYERS, goal=goal, fold=fold
    )
    lay = np.insert(plan.path.points[1:], 2, HANGING, axis=1)
    let_go = retreat(plan.held(), fold).as_array()[None]

    parts = (approach, carried, lay, let_go)
    fastest = min(installation.limits.x.velocity, installation.limits.z.velocity)
    speeds = (fastest, fold.speed, fold.lay_speed, fastest)
    return np.concatenate(parts), np.repeat(speeds, [len(part) for part in parts])


def approach_poses(length: float, fold: FoldSettings) -> tuple[Pose, ...]:
    """Poses of the gripper from beside a strip of `length` [m], where the strip is
    judged, to the strip's edge.

    The first one leaves the strip free to be judged; from beyond its edge the open
    fingers go down and over it.
    """
    beside = length + fold.approach
    return (
        Pose(beside, fold.clear_height, 0.0),
        Pose(beside, 2 * fold.approach, 0.0),
        Pose(beside, 0.0, 0.0),
        Pose(length, 0.0, 0.0),
    )


def taut_edge(touch: Touch) -> float:
    """Position x [m] of the grasped edge if the upper layer lies taut from the layers'
    `touch` on.
    """
    return touch.x - touch.to_grasped


def edge_target(taut: float, goal: float) -> float:
    """Position x [m] at which the grasped edge is to lie: `goal`, but within PULL of
    `taut`, where the upper layer ends.

    `goal` is 0, on the fixed edge, in a half fold, unless a learned correction of the
    camera's bias moves it.
    """
    return min(max(goal, taut - PULL), taut + PULL)


class LayPlan(NamedTuple):
    """Plan for laying a grasped edge: the `path` of the gripper, and the position x
    [m], `end`, of the edge after its release.
    """

    path: Path
    end: float

    def held(self, pushed: float = 0.0) -> Pose:
        """Pose of the gripper when the edge is down and has been pushed on along x by
        `pushed` [m].
        """
        x, z = self.path.points[-1].tolist()
        return Pose(x + pushed, z, HANGING)


def lay_plan(
    gripper: Pose, taut: float, layers: float, goal: float, fold: FoldSettings
) -> LayPlan:
    """Plan to lay the grasped edge down at x = `goal` [m], where the upper layer is
    taut up to x = `taut` [m].

    The hand stays upright: its thick fingers never come between the layers, one of them
    holds the upper layer down. Straight to `lay_height` above where the edge comes
    down, unless the gripper is below that, and down, until the fingers' ends are ROOM
    above the upper layer, whose surface lies `layers` [m] above the lower's midline.

    From that height the upper layer comes down as a lid, in part lifted, where friction
    does not hold it. There its end bends up to the grip, over the fingers' height, less
    `lay_beyond`: farther out the edge draws the fold along. No circle about the touch:
    that starts sideways, pulls the contact along and rolls soft folds by 15 to 40 mm.
    """
    end = edge_target(taut, goal)
    height = layers + ROOM + TIP_AHEAD
    down = min(end, taut) + height - fold.lay_beyond
    top = height + fold.lay_height
    above = [(down, top)] if gripper.z > top else []
    points = [(gripper.x, gripper.z), *above, (down, height)]
    return LayPlan(Path.through(np.array(points)), end)


def retreat(laid: Pose, fold: FoldSettings) -> Pose:
    """Pose of the gripper straight above the pose `laid` at which it let
    the edge go.
    """
    return Pose(laid.x, laid.z + 3 * fold.approach, laid.pitch)


def triangle(length: float) -> Array:
    """Path (n, 2), x and z [m], of a plain fold of a strip of `length` [m]: up over its
    middle, then down to its other edge.
    """
    corners = np.array(
        [(length, 0.0), (length / 2, length / 2), (NEAR_EDGE, NEAR_EDGE)]
    )
    shares = np.linspace(0.0, 1.0, LEG_POINTS)[:, None]
    up, down = (start + shares * (stop - start) for start, stop in pairwise(corners))
    return np.concatenate([up, down[1:]])


def largest_speed(points: Array, limits: MotionLimits) -> float:
    """Largest speed [m/s] at which an arm within `limits` can follow the path through
    `points` (n, 2), x and z [m].

    At a constant speed v, the first, second and third derivative of the path by its
    length, times v, v^2 and v^3, are the velocity, acceleration and jerk that it asks
    of each axis; here as differences over steps of CORNER. Of the pitch only the
    velocity counts, where an arm does not allow TURNING.
    """
    path = Path.through(points)
    turning = limits.pitch.velocity
    poses = path.poses(np.arange(0.0, path.length, CORNER))

    allowed = [
        [
            limits.x.velocity,
            limits.z.velocity,
            turning if turning < TURNING else np.inf,
        ],
        [axis.acceleration for axis in limits.axes[:2]],
        [axis.jerk for axis in limits.axes[:2]],
    ]
    speeds = []
    for order, most in enumerate(allowed, 1):
        needed = (
            np.abs(np.diff(poses, order, axis=0)).max(axis=0, initial=0.0)
            / CORNER**order
        )
        shares = np.array(most) / np.maximum(needed[: len(most)], LEAST_NEED)
        speeds.append(float(shares.min()) ** (1.0 / order))

    return float(min(speeds))


def _thin_out(points: Array) -> Array:
    """Points of a path, (n, 2) [m], each at least POINT_SPACING from the one kept
    before; the last point is always kept.
    """
    kept = [points[0]]
    for point in points[1:]:
        if lengths(point - kept[-1]) >= POINT_SPACING:
            kept.append(point)
    return np.array([*kept, points[-1]])
