"""Lay motion, the end of a fold: lowers the grasped edge to the desk, pushes it to its
target.
"""

from math import sqrt

import numpy as np

from cell.base.devices.fold_path import HANGING, LYING, lay_pitch
from cell.orchestrator.snapshot import Drive, Snapshot
from cell.orchestrator.steps import Motion, drive, move
from drivers.base.types import Pose
from policies.follower import Follower
from policies.path import Path

TURN_GAIN = 10.0  # 1/s, how fast an error of pitch is taken out
BRAKING = 0.5  # m/s^2, less than any arm's limit, towards the end of the path
LAY_TURNING = 2.0  # rad/s of the hand in a lay at most: a short lay is a slow one
# m/s, least speed, so that braking by the distance left reaches the path's end
CREEP = 0.005


def follow_lay(path: Path, speed: float, begin: Snapshot) -> Motion:
    """Follow the lay path at `speed` [m/s], the pitch turning from hanging to lying
    backward.

    Most of the turn comes at the end: an edge that lies back early pushes what hangs
    from it. The gripper slows down in time: one that brakes at the end of the path only
    meets the desk.
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
        # rad/m, slope of lay_pitch
        turning = 2.0 * (LYING - HANGING) * share / path.length
        rate = turning * pace + TURN_GAIN * (float(lay_pitch(share)) - pose.pitch)
        rate = min(max(rate, -LAY_TURNING), LAY_TURNING)
        stopping = max(CREEP, sqrt(2 * BRAKING * max(path.length - progress, 0.0)))
        pace = min(speed, stopping, LAY_TURNING / max(turning, 1.0))
        snapshot = yield drive(decision, rate)
    end = path.points[-1]
    return (yield from move(Pose(float(end[0]), float(end[1]), LYING)))
