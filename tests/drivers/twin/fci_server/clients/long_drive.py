"""pylibfranka drives a given number of ticks: how far it comes, what stops it."""

import json
import os
import sys
import time

import pylibfranka as fci

address, ticks = sys.argv[1], int(sys.argv[2])
robot = fci.Robot(address, fci.RealtimeConfig.kIgnore)
# The library raises this thread to the highest real-time priority; the server needs the
# core too.
os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
control = robot.start_cartesian_velocity_control(fci.ControllerMode.JointImpedance)
done, said, start = 0, "finished", time.monotonic()
try:
    for _ in range(ticks):
        control.readOnce()
        control.writeOnce(fci.CartesianVelocities([0.0] * 6))
        done += 1
    last = fci.CartesianVelocities([0.0] * 6)
    last.motion_finished = True
    control.writeOnce(last)
except Exception as error:  # noqa: BLE001 - what it is called is the answer
    said = type(error).__name__
print(json.dumps({"ticks": done, "said": said, "seconds": time.monotonic() - start}))
