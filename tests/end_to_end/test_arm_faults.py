"""Faults of a robot, driven through its own library: named, at rest, recorded."""

import subprocess
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip("pylibfranka", reason="the robot's library is not installed")

from cell.base.config.places import find_configs
from cell.folding.fold import fold
from cell.folding.request import RecordingOptions
from cell.record.run import read_run
from drivers.base.errors import Fault
from drivers.base.readers import read_yaml
from drivers.twin.fci_server.faults import VersionFault
from tests.drivers.franka.rig import arm_of, served
from tests.lab.faults.blow import Blow, strike
from tests.lab.studies.kit.folds import cached_calibration
from tests.support.children import wait_for_state
from tests.support.requests import request_for

OUTCOMES = read_yaml(Path(__file__).with_suffix(".yaml"))
LONG = ("robot: user stop", "robot: silent 0.7 s", "robot: silent 1.5 s")
# in which the arm follows commands
STATES = ("PREFLIGHT", "GRASP", "LIFT", "FOLD", "LAY")


BLOWS = [
    pytest.param(fault, state, marks=pytest.mark.slow if is_short else pytest.mark.long)
    for fault in OUTCOMES
    for state in STATES
    for is_short in (state == "PREFLIGHT" and fault not in LONG,)
]


@pytest.mark.parametrize(("fault", "state"), BLOWS)
def test_fault_is_named_the_arm_rests_and_the_record_is_whole(
    fault, state, tmp_path
) -> None:
    came = strike(Blow(fault, state, 3), tmp_path, cached_calibration())
    assert came["outcome"] in OUTCOMES[fault]
    assert came["resting"]
    assert came["whole"]


@pytest.mark.slow
def test_robot_of_another_version_is_named_with_both_versions() -> None:
    with served() as robot:
        robot.inject(VersionFault(kind="wrong_version", at=0))
        with pytest.raises(Fault, match=r"9.*10|10.*9") as refused:
            arm_of(robot).connect()
    assert refused.value.name == "arm_version"


@pytest.mark.slow
def test_arm_rests_when_its_cell_is_killed(tmp_path) -> None:
    with served(between=lambda: 0.001) as robot:
        command = [sys.executable, "-m", __name__, robot.address, str(tmp_path)]
        victim = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE
        )
        folder = wait_for_state("LIFT", tmp_path, victim)
        victim.kill()
        end = time.monotonic() + 3
        while robot.robot.motion is not None and time.monotonic() < end:
            time.sleep(0.01)
        time.sleep(0.5)
        assert robot.robot.posture.at_rest
        victim.communicate()
    run = read_run(folder)
    assert run.died
    assert run.result is None


if __name__ == "__main__":
    robot = find_configs(None).cell().with_drivers("fci")
    fci = robot.fci.model_copy(update={"address": sys.argv[1], "lock_step": True})
    robot = robot.model_copy(update={"fci": fci})
    runs, record = Path(sys.argv[2]), RecordingOptions("none")
    request = request_for("denim", "triangular", runs, cell=robot, record=record)
    fold(request, cached_calibration())
