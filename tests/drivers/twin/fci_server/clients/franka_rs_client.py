"""franka-rs against the server: connect, configure, move, meet a wall, recover,
retreat, stop.
"""

import json
import os
import sys
import time

import franka

UNTIL_WALL, RETREAT = 0.2, -0.01
PATIENCE = 20.0  # s


def configure(robot: franka.Robot, force: float) -> None:
    robot.set_collision_behavior(*[[force] * 7] * 4, *[[force] * 6] * 4)


def carry(robot: franka.Robot, distance: float) -> None:
    """Along y by `distance` [m]."""
    with robot.cartesian_targets(
        backend="robot", controller_mode="joint_impedance"
    ) as targets:
        goal = targets.state().O_T_EE[1, 3] + distance
        targets.move_by([0.0, distance, 0.0])
        end = time.monotonic() + PATIENCE
        while targets.running and abs(targets.state().O_T_EE[1, 3] - goal) > 1e-5:
            assert time.monotonic() < end
            time.sleep(0.005)


def newest(robot: franka.Robot) -> franka.RobotState:
    robot.read_once()
    return robot.read_once()


robot = franka.Robot(sys.argv[1], realtime="ignore")
# The library raises this thread to the highest real-time priority; the server needs the
# core too.
os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
told: dict[str, object] = {"begun": robot.read_once().robot_mode}
configure(robot, 20.0)
start = newest(robot).O_T_EE[1, 3]
carry(robot, 0.02)
told["moved"] = float(newest(robot).O_T_EE[1, 3] - start)
try:
    carry(robot, UNTIL_WALL)
except franka.ControlException:
    state = newest(robot)
    told["reflex"] = [state.robot_mode, *state.last_motion_errors]
robot.automatic_error_recovery()
configure(robot, 60.0)
told["recovered"] = newest(robot).robot_mode
carry(robot, RETREAT)
with robot.cartesian_targets(
    backend="robot", controller_mode="joint_impedance"
) as targets:
    robot.stop()
    try:
        targets.stop()
    except franka.ControlException as preempted:
        told["preempted"] = str(preempted)
told["stopped"] = newest(robot).robot_mode
print(json.dumps(told))
