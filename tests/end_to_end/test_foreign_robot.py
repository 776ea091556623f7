"""The commands on a robot's server that others wrote, unmodified, in real time on
loopback.
"""

import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("pylibfranka", reason="the robot's library is not installed")

from drivers.franka.checks import PORT, read_description
from drivers.franka.kinematics import HOME
from drivers.franka.limits import FR3V2, JointLimits
from tests.support.franky_sim import franky_sim_python

ADDRESS = "127.0.3.1"
NAME = "twin-cell"  # of the cell, typed where a real robot would move
STARTED = 60.0  # s until the server listens, on a busy machine
PATIENCE = 300.0  # s for a command
URGENT = ("nice", "-n", "-10")  # of what runs in real time, where that is allowed

READ = f"""
import pylibfranka as franka
robot = franka.Robot("{ADDRESS}", franka.RealtimeConfig.kIgnore)
states = [robot.read_once() for _ in range(50)]
print(*states[-1].q)
"""


@pytest.fixture(scope="module")
def robot() -> Iterator[None]:
    program = franky_sim_python().parent / "franky-sim"
    command = [*URGENT, program, "--simulator", "mujoco", "--hostname", ADDRESS]
    with subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    ) as server:
        until = time.monotonic() + STARTED
        while time.monotonic() < until and not listening():
            time.sleep(0.2)
        yield
        server.kill()


def listening() -> bool:
    with socket.socket() as link:
        return link.connect_ex((ADDRESS, PORT)) == 0


@pytest.fixture(scope="module")
def configs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("configs")
    text = Path("configs/cell.yaml").read_text("utf-8")
    robot = f"{{address: {ADDRESS}, realtime: ignore, lock_step: false}}"
    text = text.replace("z: [-0.01, 0.50]", "z: [-0.01, 0.60]")
    text = text.replace("{arm: twin,", "{arm: fci,") + f"fci: {robot}\n"
    (folder / "cell.yaml").write_text(text, "utf-8")
    for name in ("strips", "calibration"):
        (folder / name).symlink_to(Path("configs", name).resolve())
    return folder


def cell(configs: Path, *words: str) -> str:
    """What a command prints that ends well."""
    command = [*URGENT, sys.executable, "-m", "cell", *words]
    done = subprocess.run(
        [*command, "--configs", str(configs)],
        input=f"{NAME}\n",
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def joints() -> np.ndarray:
    done = subprocess.run(
        [sys.executable, "-c", READ], capture_output=True, text=True, check=True
    )
    return np.array(done.stdout.split(), dtype=np.float64)


@pytest.mark.slow
def test_cell_drives_a_robot_s_server_that_others_wrote(
    robot: None, configs: Path, tmp_path: Path
) -> None:
    description = read_description(ADDRESS)
    assert description is not None
    assert JointLimits.from_description(description) == FR3V2

    assert "home" in cell(configs, "home", "--strip", "denim", "--full-speed")
    assert "open" in cell(configs, "open")
    rehearse = ("--policy", "planned", "--rehearse", "--full-speed")
    runs = ("--runs", str(tmp_path / "runs"))
    assert "moved" in cell(configs, "fold", "--strip", "denim", *rehearse, *runs)
    assert "parked" in cell(configs, "park", "--full-speed")
    assert joints() == pytest.approx(HOME, abs=5e-3)
