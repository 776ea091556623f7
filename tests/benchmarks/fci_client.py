"""The client of bench_fci.py, in a process of its own because pylibfranka holds the GIL.

python -m tests.benchmarks.fci_client ADDRESS CONNECTIONS ROUNDS TICKS
"""

import json
import os
import sys
import time

import numpy as np
import pylibfranka as fci

SPEED = 0.05  # m/s


def connect(address: str) -> tuple[fci.Robot, float]:
    start = time.perf_counter()
    robot = fci.Robot(address, fci.RealtimeConfig.kIgnore)
    waited = time.perf_counter() - start
    # The library raises this thread to the highest real-time priority; the server shares the core.
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    return robot, waited


def drive(robot: fci.Robot, ticks: int) -> dict[str, float]:
    """There and back along y in `ticks` commands of velocity.

    Wall and CPU time a tick [s] on average, and the median tick, which a machine that is busy with
    other things disturbs less.
    """
    speeds = SPEED * np.sin(2 * np.pi * np.arange(ticks) / ticks) ** 3
    commands = [fci.CartesianVelocities([0.0, speed, 0.0, 0.0, 0.0, 0.0]) for speed in speeds]
    commands[-1].motion_finished = True
    control = robot.start_cartesian_velocity_control(fci.ControllerMode.JointImpedance)
    for _ in range(100):
        control.readOnce()
        control.writeOnce(fci.CartesianVelocities([0.0] * 6))
    cpu, stamps = time.process_time(), [time.perf_counter()]
    for command in commands:
        control.readOnce()
        control.writeOnce(command)
        stamps.append(time.perf_counter())
    return {
        "wall": (stamps[-1] - stamps[0]) / ticks,
        "median": float(np.median(np.diff(stamps))),
        "cpu": (time.process_time() - cpu) / ticks,
    }


def main() -> None:
    address, connections, rounds, ticks = sys.argv[1], *map(int, sys.argv[2:5])
    waits = []
    for _ in range(connections):
        robot, waited = connect(address)
        waits.append(waited)
        del robot
    robot, _ = connect(address)
    told = {"connect": waits, "rounds": [drive(robot, ticks) for _ in range(rounds)]}
    print(json.dumps(told))


if __name__ == "__main__":
    main()
