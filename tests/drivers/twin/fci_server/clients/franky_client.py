"""franky against the server: connect, configure, move, meet a wall, recover, retreat,
stop.
"""

import json
import os
import sys

import franky

UNTIL_WALL, RETREAT = 0.2, -0.01


def configure(robot: franky.Robot, force: float) -> None:
    robot.set_collision_behavior([force] * 7, [force] * 7, [force] * 6, [force] * 6)


def along(distance: float) -> franky.CartesianMotion:
    """Along the base's y by `distance` [m]; the hand hangs with its y-axis the other
    way.
    """
    turned = franky.Affine([0.0, -distance, 0.0])
    return franky.CartesianMotion(turned, franky.ReferenceType.Relative)


def height(robot: franky.Robot) -> float:
    return float(robot.current_cartesian_state.pose.end_effector_pose.translation[1])


def name(robot: franky.Robot) -> str:
    return robot.state.robot_mode.name


def flags(errors: franky.Errors) -> list[str]:
    return [flag for flag in dir(errors) if getattr(errors, flag) is True]


robot = franky.Robot(sys.argv[1], realtime_config=franky.RealtimeConfig.Ignore)
# The library raises this thread to the highest real-time priority; the server needs the
# core too.
os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
robot.relative_dynamics_factor = 0.1
told: dict[str, object] = {"begun": name(robot)}
configure(robot, 20.0)
start = robot.state.O_T_EE.translation[1]
robot.move(along(0.02))
told["moved"] = robot.state.O_T_EE.translation[1] - start
try:
    robot.move(along(UNTIL_WALL))
except franky.ControlException:
    state = robot.state
    told["reflex"] = [state.robot_mode.name, *flags(state.last_motion_errors)]
robot.recover_from_errors()
configure(robot, 60.0)
told["recovered"] = name(robot)
robot.move(along(RETREAT))
robot.move(along(RETREAT), asynchronous=True)
robot.stop()
try:
    robot.join_motion()
except franky.ControlException as preempted:
    told["preempted"] = str(preempted)
told["stopped"] = name(robot)
print(json.dumps(told))
