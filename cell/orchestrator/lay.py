"""Lay motion, the end of a fold: lowers the grasped edge to the desk, pushes it to its target."""

from math import sqrt

import numpy as np

from cell.config.settings import FoldSettings
from cell.orchestrator.snapshot import Drive, Snapshot
from cell.orchestrator.steps import Motion, drive, move
from cell.perception.strip_measurement import SeenTouch
from drivers.types import Pose
from policies.follower import Follower
from policies.path import Path

HANGING = np.pi / 2
TURN_GAIN = 10.0  # 1/s, how fast an error of pitch is taken out
BRAKING = 0.5  # m/s^2, less than any arm's limit, towards the end of the path
TURNING = 2.0  # rad/s of the hand in a lay at most: a short lay is a slow one
CREEP = 0.005  # m/s, least speed, so that braking by the distance left reaches the path's end
CLEARANCE = 0.0005  # m over the lower layer: an edge that presses on it drags it along
PULL = 0.01  # m by which an upper layer that is too short is pulled along at most


def edge_place(touch: SeenTouch, place: float = 0.0) -> float:
    """Target x [m] of the grasped edge: `place`, within PULL of the taut upper layer's end.

    `place` is 0, on the fixed edge, unless a learned correction of the camera's bias moves it.
    """
    return min(max(place, _taut_edge(touch) - PULL), _taut_edge(touch) + PULL)


def lay_path(touch: SeenTouch, gripper: Pose, rest: float, end: float, fold: FoldSettings) -> Path:
    """Path of the gripper that lowers the grasped edge past the taut upper layer's edge.

    Straight to `lay_height` above `end` [m], unless the gripper is below that, and down to `rest`
    [m] above the desk, `lay_beyond` past that edge, from where it is pushed to `end`.

    From that height the upper layer comes down as a lid, in part lifted, where friction does not
    hold it. One that the fold has rolled along is too long: lowered at its end it keeps a hump at
    the grip, which yields to a push, and springs beyond the edge on release. Lowered past its
    end it lies flat, and a flat layer passes a push on to the fold, which rolls back. No circle
    about the touch: that starts sideways, pulls the contact along and rolls soft folds by 15 to
    40 mm.
    """
    down = min(end, _taut_edge(touch) - fold.lay_beyond)
    above = [(end, fold.lay_height)] if gripper.z > fold.lay_height else []
    return Path.through(np.array([(gripper.x, gripper.z), *above, (down, rest)]))


def _taut_edge(touch: SeenTouch) -> float:
    """Position x [m] that the grasped edge would have if the upper layer lay taut."""
    return touch.x - touch.to_grasped


def follow_lay(path: Path, speed: float, begin: Snapshot) -> Motion:
    """Follow the lay path at `speed` [m/s], the pitch turning from hanging to lying backward.

    Most of the turn comes at the end: an edge that lies back early pushes what hangs from it. The
    gripper slows down in time: one that brakes at the end of the path only meets the desk.
    """
    follower = Follower(path, 1)
    pace = speed
    snapshot = yield Drive(begin.velocity)
    while True:
        pose = snapshot.arm.pose
        decision = follower.decide(np.array([pose.x]), np.array([pose.z]), pace)
        if decision.done[0]:
            break
        progress = float(follower.progress[0])
        share = progress / path.length
        turning = 2.0 * HANGING * share / path.length  # rad/m, slope of HANGING (1 + share^2)
        rate = turning * pace + TURN_GAIN * (HANGING * (1.0 + share**2) - pose.pitch)
        rate = min(max(rate, -TURNING), TURNING)
        stopping = max(CREEP, sqrt(2 * BRAKING * max(path.length - progress, 0.0)))
        pace = min(speed, stopping, TURNING / max(turning, 1.0))
        snapshot = yield drive(decision, rate)
    end = path.points[-1]
    return (yield from move(Pose(float(end[0]), float(end[1]), np.pi)))
