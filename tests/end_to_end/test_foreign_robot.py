"""The commands on a robot's server that others wrote, unmodified, in real time on
loopback.

CELL_ROUNDS=10 repeats each motion as often, in a row.
"""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.lib.stride_tricks import sliding_window_view

pytest.importorskip("pylibfranka", reason="the robot's library is not installed")

from drivers.base.motion import TICK
from drivers.franka.checks import read_description
from drivers.franka.joint_motion import ROUNDING
from drivers.franka.kinematics import HOME, forward
from drivers.franka.limits import ACCELERATION, FR3V2, JERK, JointLimits
from tests.support.franky_sim import franky_sim_python

pytestmark = pytest.mark.slow

ADDRESS = "127.0.3.1"
NAME = "twin-cell"  # of the cell, typed where a real robot would move
STARTED = 60.0  # s until the server answers, on a busy machine
PATIENCE = 300.0  # s for a command
HALF_WAY = 8.0  # s after which a slow way has begun and is not over
ROUNDS = int(os.environ.get("CELL_ROUNDS", "1"))
URGENT = ("nice", "-n", "-20")  # of what runs in real time, where that is allowed
# the robot is a machine of its own: what folds never holds it up
PROMPT = """
import os, sys
from drivers.base.clock import take_priority, wake_promptly
take_priority(50) or wake_promptly()
os.execv(sys.argv[1], sys.argv[1:])
"""
REALTIME = "ignore" if os.geteuid() else "priority"
# images come late where robot, arm, twin and reading share two processors
AGES = "monitors: {image_age: 0.5, image_wait: 0.5, reading: 0.5}\n"
# as many images as two processors draw and read beside the robot
CAMERA = "  camera: {rate: 10, transport_delay: 0.06}\n"
DENIM = ("--strip", "denim")
# joint 7 of that robot creeps with each client
JOGS = {"--z": 2, "--x": 1}  # axis of the robot's base

READ = f"""
import pylibfranka as franka
robot = franka.Robot("{ADDRESS}", franka.RealtimeConfig.kIgnore)
"""
JOINTS = READ + "print(*[robot.read_once() for _ in range(50)][-1].q)"
LOAD = (
    READ + "robot.set_load(0.5, [0.0, 0.0, 0.05], [1e-3, 0, 0, 0, 1e-3, 0, 0, 0, 1e-3])"
)


@pytest.fixture(scope="module")
def robot() -> Iterator[subprocess.Popen[bytes]]:
    program = franky_sim_python().parent / "franky-sim"
    arguments = [program, "--simulator", "mujoco", "--hostname", ADDRESS]
    command = [*URGENT, sys.executable, "-c", PROMPT, *arguments]
    with subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    ) as server:
        until = time.monotonic() + STARTED
        while time.monotonic() < until and read_description(ADDRESS) is None:
            time.sleep(0.2)
        yield server
        server.kill()


@pytest.fixture(scope="module")
def configs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of a cell whose arm trails its commands by 0.1 s: 10 mm at its speed."""
    folder = tmp_path_factory.mktemp("configs")
    text = Path("configs/cell.yaml").read_text("utf-8")
    robot = f"{{address: {ADDRESS}, realtime: {REALTIME}, lock_step: false}}"
    text = text.replace("z: [-0.01, 0.50]", "z: [-0.01, 0.60]")
    text = text.replace("{velocity: 0.2, acc", "{velocity: 0.1, acc")
    text = text.replace("\ntwin:\n", f"\ntwin:\n{CAMERA}")
    text = text.replace("{arm: twin,", "{arm: fci,") + f"fci: {robot}\n{AGES}"
    (folder / "cell.yaml").write_text(text, "utf-8")
    (folder / "strips").symlink_to(Path("configs/strips").resolve())
    return folder


def started(configs: Path, *words: str) -> subprocess.Popen[str]:
    """A command under way, whose operator agrees to a motion."""
    command = [*URGENT, sys.executable, "-m", "cell", *words, "--configs", str(configs)]
    pipe = subprocess.PIPE
    process = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, text=True)
    process.stdin.write(f"{NAME}\n")
    process.stdin.flush()
    return process


def ended(process: subprocess.Popen[str]) -> tuple[int, str]:
    """Exit code of a command, and what it printed."""
    said, errors = process.communicate(timeout=PATIENCE)
    return process.returncode, said + errors


def cell(configs: Path, *words: str) -> str:
    """What a command prints that ends well."""
    code, said = ended(started(configs, *words))
    assert code == 0, said
    return said


def run(*words: str) -> str:
    """What Python prints that talks to the robot by the maker's library."""
    command = [*URGENT, sys.executable, *words]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


def joints() -> np.ndarray:
    return np.array(run("-c", JOINTS).split(), dtype=np.float64)


def hand() -> np.ndarray:
    """Place (3,) [mm] of the hand by the joints that the robot measures."""
    return 1e3 * forward(joints())[:3, 3]


def test_limits_are_those_of_the_robot(robot: object) -> None:
    description = read_description(ADDRESS)
    assert description is not None
    assert JointLimits.from_description(description) == FR3V2


def test_every_motion_arrives_at_the_first_try(
    robot: object, configs: Path, tmp_path: Path
) -> None:
    for number in range(ROUNDS):
        assert "home" in cell(configs, "home", *DENIM, "--full-speed")
        for option, axis in JOGS.items():
            for way in (20.0, -20.0):  # mm
                before = hand()
                cell(configs, "jog", option, f"{way}mm", "--full-speed")
                moved = hand() - before
                assert moved[axis] == pytest.approx(way, abs=1.0)
        assert "open" in cell(configs, "open")
        assert "home" in cell(configs, "home", *DENIM, "--full-speed")
        rehearse = ("--policy", "planned", "--rehearse", "--full-speed")
        runs = ("--runs", str(tmp_path / f"runs{number}"))
        assert "moved" in cell(configs, "fold", *DENIM, *rehearse, *runs)
        assert "parked" in cell(configs, "park", "--full-speed")
        assert joints() == pytest.approx(HOME, abs=5e-3)


def test_commanded_joints_stay_within_the_limits_of_the_robot_s_description(
    robot: object,
) -> None:
    rows = json.loads(run("-m", "tests.support.commanded_motion", ADDRESS))
    time, found, sent = np.split(np.array(rows), [1, 8], axis=1)
    # without a command that robot holds its joints, which is no series of the cell's
    obeyed = np.diff(time[:, 0]) < 1.5 * TICK
    obeyed &= np.abs(found[1:] - sent[:-1]).max(axis=1) < ROUNDING
    assert obeyed.mean() > 0.5
    for order, limit in enumerate((FR3V2.velocity, ACCELERATION, JERK), 1):
        rates = np.diff(found, order, axis=0) / TICK**order
        in_time = sliding_window_view(obeyed, order).all(axis=1)
        assert (np.abs(rates[in_time]) <= limit).all()


def test_whole_fold_misses_by_less_than_five_millimetres(
    robot: object, configs: Path, tmp_path: Path
) -> None:
    cell(configs, "home", *DENIM, "--full-speed")
    fold = ("--policy", "planned", "--full-speed", "--json", "--runs", str(tmp_path))
    result = json.loads(cell(configs, "fold", *DENIM, *fold).splitlines()[0])
    assert result["displacement_true"] == pytest.approx(0.0, abs=5e-3)


def test_tool_that_another_program_left_is_refused_and_reset(
    robot: object, configs: Path
) -> None:
    run("-c", LOAD)
    before = joints()
    code, said = ended(started(configs, "park", "--full-speed"))
    assert code == 4
    assert "arm_tool_differs" in said
    assert "0.50 kg" in said
    assert joints()[:6] == pytest.approx(before[:6], abs=5e-3)
    cell(configs, "home", *DENIM, "--full-speed", "--reset-tool")


def test_ctrl_c_half_way_leaves_the_arm_at_rest_between(
    robot: object, configs: Path
) -> None:
    cell(configs, "home", *DENIM, "--full-speed")
    begin = joints()
    under_way = started(configs, "park")
    time.sleep(HALF_WAY)
    under_way.send_signal(signal.SIGINT)
    code, said = ended(under_way)
    assert code == 130, said
    stopped = joints()
    assert np.abs(stopped - begin).max() > 0.01
    assert np.abs(stopped - HOME).max() > 0.01
    assert joints()[:6] == pytest.approx(stopped[:6], abs=2e-3)


def test_robot_that_dies_half_way_is_said_in_a_line(
    robot: subprocess.Popen[bytes], configs: Path
) -> None:
    cell(configs, "home", *DENIM, "--full-speed")
    under_way = started(configs, "park")
    time.sleep(HALF_WAY)
    robot.kill()
    code, said = ended(under_way)
    assert code == 4
    assert "arm_network" in said
    assert "Traceback" not in said
