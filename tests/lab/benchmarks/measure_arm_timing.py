"""Share of the robot's states answered in time on the wall clock, by a folding cell.

python -m tests.lab measure-arm-timing [--seconds 120] [--strip denim] [--realtime
ignore]

An emulated robot runs by the wall clock in a process of its own, with real-time
priority where this user may have it: a robot shares no processor with its client. In
turn a bare loop of the client's library holds it still, and the cell folds a strip with
it: renders, perceives, decides and records. Printed are the shares of states that were
answered in time, by the robot's own count. Both run as `fci.realtime` says: with
real-time priority (the default, no real-time kernel is asked for), or as ordinary
processes with `ignore`.
"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import yaml

from cell.base.config.places import find_configs
from cell.base.devices.fci import start_joints
from cell.folding.fold import fold
from cell.folding.request import RecordingOptions
from cell.record.run import read_run
from cell.setup.calibration_in_use import calibration_of
from drivers.base.errors import Fault
from drivers.base.types import frozen
from drivers.franka.joint_log import Timing
from drivers.franka.joint_requests import GoTo, go_to
from drivers.franka.process import PRIORITY, RobotAccess, apply_realtime
from drivers.franka.settings import RealTime
from drivers.strip.describe import load_strip
from drivers.twin.fci_server.server import RobotServer, ServerSettings
from tests.support.requests import request_for

PROCESSORS = sorted(os.sched_getaffinity(0))
TRIES = 10
BAR = 2.0  # points at most between the bare loop and the cell
STILL = 10.0  # s of the bare loop at a time
# m/s of the folds, half of the usual: late ticks turn the hand too far in the lift
SPEED = 0.05
RATE = 12.0  # Hz of the simulated camera: all of the twin is computed beside the loop
BETWEEN = 0.0005  # m, always between the fingers: this robot knows no strip
THIS = (sys.executable, "-m", "tests.lab", "measure-arm-timing")


@dataclass(slots=True)
class Share:
    """Time-weighted share of states answered in time, over `seconds` of a control
    loop.
    """

    seconds: float = 0.0
    answered: float = 0.0

    def add(self, seconds: float, answered: float) -> None:
        self.seconds += seconds
        self.answered += seconds * answered

    @property
    def percent(self) -> float:
        """Share of the states [%], NaN before any."""
        return 100 * self.answered / self.seconds if self.seconds else float("nan")

    def __str__(self) -> str:
        return f"{self.percent:6.2f} % answered in {self.seconds:4.0f} s"


def serve(joints: list[float]) -> None:
    """Be the robot, by the wall clock, until killed: on the last processor, if there
    are several, which its clients leave alone.
    """
    os.sched_setaffinity(0, PROCESSORS[-1:])
    with suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY // 2))
    settings = ServerSettings(lock_step=False)
    server = RobotServer(settings, start=frozen(joints), between=lambda: BETWEEN)
    print(server.address, flush=True)
    server.serve()


def hold_still(address: str, seconds: float, realtime: RealTime) -> None:
    """Answer every state of the robot with its present pose for some `seconds`."""
    import pylibfranka as franka

    robot = franka.Robot(address, franka.RealtimeConfig.kIgnore)
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    if realtime == "priority":
        apply_realtime(realtime)
    motion = robot.start_cartesian_pose_control(franka.ControllerMode.JointImpedance)
    state, _ = motion.readOnce()
    pose, timing, end = list(state.O_T_EE_c), Timing(), time.monotonic() + seconds
    while (now := time.monotonic()) < end:
        motion.writeOnce(franka.CartesianPose(pose))
        state, _ = motion.readOnce()
        timing.update(now, state.control_command_success_rate)
    last = franka.CartesianPose(pose)
    last.motion_finished = True
    motion.writeOnce(last)
    print(timing.content()["answered"])


@contextmanager
def robot_at(joints: list[float]) -> Iterator[str]:
    """Address of a robot that runs in a process of its own."""
    command = [*THIS, "--serve-at", json.dumps(joints)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        try:
            yield server.stdout.readline().strip()
        finally:
            server.kill()


def measure(
    seconds: float, strip: str, realtime: RealTime
) -> tuple[Share, Share, list[str]]:
    """Shares of answered states of the bare loop and of the cell, and outcomes of the
    folds.
    """
    bare, cell, ends = Share(), Share(), []
    settings = find_configs(None).cell()
    file = load_strip(find_configs(None).strip_path(strip))
    installation = settings.fci.limit(settings.installation)
    joints = list(start_joints(installation, settings.fold, file.length))
    with tempfile.TemporaryDirectory() as place, robot_at(joints) as address:
        os.sched_setaffinity(0, PROCESSORS[:-1] or PROCESSORS)
        configs = configured(Path(place) / "configs", address, realtime)
        robot = find_configs(configs).cell().with_drivers("fci")
        fci = robot.fci
        record = RecordingOptions("none", truth=False)
        request = request_for(
            strip, "feedback", Path(place), configs, cell=robot, record=record
        )
        calibration = calibration_of(robot)
        while cell.seconds < seconds:
            command = [*THIS, "--hold", address, "--realtime", realtime]
            told = subprocess.run(command, check=False, capture_output=True, text=True)
            if told.returncode == 0:
                bare.add(STILL, float(told.stdout))
            else:
                ends.append("bare loop stopped by reflex")
            go_home(RobotAccess(address, fci, installation), joints)
            result = fold(request, calibration)
            header = read_run(Path(result.run)).header
            if header.arm_timing is not None:
                cell.add(result.duration, header.arm_timing.answered)
            ends.append(result.outcome)
            sys.stderr.write(
                f"{result.outcome}: {result.reason}\n  bare {bare}\n  cell {cell}\n"
            )
            go_home(RobotAccess(address, fci, installation), joints)
    return bare, cell, ends


def go_home(task: RobotAccess, joints: list[float]) -> None:
    """Bring the robot to `joints`; a machine that loses packets may need several
    tries.
    """
    for _ in range(TRIES):
        with suppress(Fault):
            go_to(task, GoTo(joints, 1.0, recover=True))
            return
    raise SystemExit(
        f"the robot did not come home in {TRIES} tries: too many packets are lost"
    )


def configured(folder: Path, address: str, realtime: RealTime) -> Path:
    """Configurations whose arm is the robot at `address`, without a real-time
    kernel.
    """
    shutil.copytree(find_configs(None).folder, folder)
    path = folder / "cell.yaml"
    content = yaml.safe_load(path.read_text())
    content["fci"] = {"address": address, "lock_step": False, "realtime": realtime}
    content["fold"]["speed"] = SPEED
    content["twin"]["camera"] = {"rate": RATE}
    path.write_text(yaml.safe_dump(content))
    return folder


def main(
    seconds: float = 120.0,
    strip: str = "denim",
    realtime: Literal["priority", "ignore"] = "priority",
    serve_at: str = "",
    hold: str = "",
) -> int:
    """Compare a bare loop with the cell; or serve the robot at these joints, or hold an
    arm.
    """
    if serve_at:
        serve(json.loads(serve_at))
    if hold:
        hold_still(hold, STILL, realtime)
        return 0
    bare, cell, ends = measure(seconds, strip, realtime)
    behind = bare.percent - cell.percent
    print(
        f"bare loop {bare}\nthe cell  {cell}\nbehind by {behind:.2f} points (bar"
        f" {BAR:.0f})"
    )
    print(f"folds ended: {', '.join(ends)}")
    return 0 if behind <= BAR else 1
