"""Joints that a robot on its own time reports as commanded, and the answer to each.

`python -m tests.support.commanded_motion ADDRESS` moves it by joints and by its hand.
"""

import json
import sys
from typing import Any

import numpy as np

from drivers.franka.joint_motion import follow_joints
from drivers.franka.kinematics import HOME
from drivers.franka.limits import FR3V2
from drivers.franka.mailbox import CommandKind
from drivers.franka.process import apply_realtime
from drivers.franka.robot import Robot
from drivers.franka.settings import FciSettings
from tests.drivers.franka.rig import JOINTS, begun

PLACES = (0.45, 0.25, 0.6), (0.55, 0.2, 0.0)  # m, m, rad


class Observed(Robot):
    """Keeps each state's time [s] and commanded joints (7,) [rad], and the joints (7,)
    that answer it.
    """

    def __init__(self, address: str) -> None:
        settings = FciSettings(address=address, realtime="ignore", lock_step=False)
        super().__init__(address, settings, FR3V2)
        apply_realtime("ignore")
        self.rows: list[list[float]] = []

    def read(self, motion: Any) -> Any:
        state = super().read(motion)
        self.rows.append([state.time.to_sec(), *state.q_d])
        return state

    def write_joints(self, motion: Any, joints: list[float], **end: bool) -> None:
        super().write_joints(motion, joints, **end)
        self.rows[-1] += joints


def main(address: str) -> None:
    """Print the answered rows of time [s] and joints (14,) [rad] as JSON."""
    robot = Observed(address)
    guard = robot.tared_guard()
    for goal in (HOME + 0.2, np.array(JOINTS)):
        follow_joints(robot, goal.tolist(), 1.0, guard, lambda _: False)
    driven = begun(robot, lock_step=False, guard=robot.tared_guard())
    for place in PLACES:
        driven.order(CommandKind.MOVE, *place)
        while driven.steps(1).moving:
            continue
    driven.loop.end()
    print(json.dumps([row for row in robot.rows if len(row) == 15]))


if __name__ == "__main__":
    main(sys.argv[1])
