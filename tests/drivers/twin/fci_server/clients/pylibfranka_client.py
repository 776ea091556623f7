"""pylibfranka against the server: connect, configure, move, meet a wall, recover,
retreat, stop.
"""

import json
import os
import sys

import numpy as np
import pylibfranka as fci

UNTIL_WALL, RETREAT, SPEED = 0.2, -0.01, 0.05


def configure(robot: fci.Robot, force: float) -> None:
    robot.set_collision_behavior([force] * 7, [force] * 7, [force] * 6, [force] * 6)


def carry(robot: fci.Robot, distance: float) -> None:
    """Along y by `distance` [m], as a smooth velocity over time."""
    control = robot.start_cartesian_velocity_control(fci.ControllerMode.JointImpedance)
    duration, elapsed = 2 * abs(distance) / SPEED, 0.0
    while elapsed < duration:
        _, period = control.readOnce()
        elapsed += period.to_sec()
        speed = (
            SPEED * np.sign(distance) * (1 - np.cos(2 * np.pi * elapsed / duration)) / 2
        )
        control.writeOnce(fci.CartesianVelocities([0.0, speed, 0.0, 0.0, 0.0, 0.0]))
    last = fci.CartesianVelocities([0.0] * 6)
    last.motion_finished = True
    control.writeOnce(last)


def named(errors: object) -> list[str]:
    return [name for name in dir(errors) if getattr(errors, name) is True]


robot = fci.Robot(sys.argv[1], fci.RealtimeConfig.kIgnore)
# The library raises this thread to the highest real-time priority; the server needs the
# core too.
os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
told: dict[str, object] = {"begun": robot.read_once().robot_mode.name}
start = robot.read_once().O_T_EE[13]
configure(robot, 20.0)
robot.set_joint_impedance([3000.0] * 7)
robot.set_cartesian_impedance([3000.0] * 3 + [300.0] * 3)
robot.set_load(0.1, [0.0] * 3, [1e-3, 0, 0, 0, 1e-3, 0, 0, 0, 1e-3])
carry(robot, 0.02)
robot.read_once()
told["moved"] = robot.read_once().O_T_EE[13] - start
try:
    carry(robot, UNTIL_WALL)
except fci.ControlException:
    state = robot.read_once()
    told["reflex"] = [
        robot.read_once().robot_mode.name,
        *named(state.last_motion_errors),
    ]
robot.automatic_error_recovery()
configure(robot, 60.0)
robot.read_once()
told["recovered"] = robot.read_once().robot_mode.name
carry(robot, RETREAT)
control = robot.start_cartesian_velocity_control(fci.ControllerMode.JointImpedance)
for _ in range(50):
    control.readOnce()
    control.writeOnce(fci.CartesianVelocities([0.0] * 6))
robot.stop()
robot.read_once()
told["stopped"] = robot.read_once().robot_mode.name
print(json.dumps(told))
