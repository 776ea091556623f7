"""The lay: the grasped edge goes down to the desk behind the touch."""

from math import sqrt

import numpy as np

from cell.orchestrator.snapshot import Drive, Snapshot
from cell.orchestrator.steps import Motion, drive, move
from cell.perception.measurement import SeenTouch
from drivers.types import Pose
from policies.follower import Follower
from policies.path import Path

HANGING = np.pi / 2
TURN_GAIN = 10.0  # 1/s, how fast an error of pitch is taken out
BRAKING = 0.5  # m/s^2, less than any arm's limit, towards the end of the path
TURNING = 2.0  # rad/s, likewise: a short lay is a slow one
CREEP = 0.005  # m/s
PULL = 0.01  # m by which an upper layer that is too short is pulled along at most


def lay_path(touch: SeenTouch, gripper: Pose, rest: float) -> Path:
    """Path from `gripper` straight to the fixed edge at x = 0, `rest` [m] above the desk.

    A layer that is too short is pulled along; the edge of one that is too long springs to the same
    place from wherever it is laid. Within `PULL` of the edge of the taut upper layer, which is
    x = touch.x - l1. A straight line, not the circle about the touch: the circle starts sideways,
    pulls the contact along and rolls soft folds by 15 to 40 mm.
    """
    taut = touch.x - touch.to_grasped
    end = min(max(0.0, taut - PULL), taut + PULL)
    return Path.through(np.array([(gripper.x, gripper.z), (end, rest)]))


def follow_lay(path: Path, speed: float, begin: Snapshot) -> Motion:
    """Follow the lay path, turning the pitch uniformly from hanging to lying backward.

    It slows down in time: a gripper that brakes at the end of the path only meets the desk.
    """
    follower = Follower(path, 1)
    speed = min(speed, TURNING * path.length / HANGING)
    snapshot, pace = (yield Drive(begin.velocity)), speed
    while True:
        pose = snapshot.arm.pose
        decision = follower.decide(np.array([pose.x]), np.array([pose.z]), pace)
        if decision.done[0]:
            break
        progress = float(follower.progress[0])
        wanted = HANGING + progress / path.length * HANGING
        rate = HANGING * pace / path.length + TURN_GAIN * (wanted - pose.pitch)
        rate = min(max(rate, -TURNING), TURNING)
        pace = min(speed, max(CREEP, sqrt(2 * BRAKING * max(path.length - progress, 0.0))))
        snapshot = yield drive(decision, rate)
    end = path.points[-1]
    return (yield from move(Pose(float(end[0]), float(end[1]), np.pi)))
