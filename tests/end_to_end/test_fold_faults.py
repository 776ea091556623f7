"""What goes wrong stops the arm, is named, and is recorded."""

import json
import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cell.folding.fold import fold
from cell.record.run import read_run
from cell.report.page import write_report
from drivers.twin.world import World
from tests.lab.faults.blow import Blow, strike
from tests.lab.studies.kit.folds import cached_calibration
from tests.support.children import wait_for_state
from tests.support.requests import request_for

slow = pytest.mark.slow


@pytest.mark.parametrize(
    ("fault", "state", "outcome", "stop", "rest"),
    [
        ("camera: frozen", "FOLD", "image_frozen", 0.15, 0.5),
        # it stands, and waits for an image, before it is named
        pytest.param("camera: silent", "FOLD", "image_stale", 0.5, 0.35, marks=slow),
        pytest.param(
            "camera: half of it noise", "FOLD", "low_confidence", 0.55, 0.9, marks=slow
        ),
        ("twin: diverges", "FOLD", "simulation_not_finite", 0.05, 0.35),
        ("hand: width 0", "GRASP", "grasp_missed", 3.0, 3.0),
    ],
)
def test_fault_stops_the_arm_in_time_and_is_named(
    fault: str, state: str, outcome: str, stop: float, rest: float, tmp_path: Path
) -> None:
    came = strike(Blow(fault, state, 3), tmp_path, cached_calibration())
    assert (came["outcome"], came["exit_code"]) == (outcome, 4)
    assert came["stop"] < stop
    assert came["rest"] < rest
    assert came["resting"]
    assert came["whole"]


def test_no_strip_on_the_desk_is_refused_before_the_grasp(
    monkeypatch, tmp_path
) -> None:
    scene = World.scene
    monkeypatch.setattr(
        World, "scene", lambda world, t: replace(scene(world, t), strip=False)
    )
    result = fold(request_for("denim", "triangular", tmp_path), cached_calibration())
    assert (result.outcome, result.exit_code) == ("preflight_refused", 3)
    assert len(read_run(Path(result.run)).ticks.t) == 0


def start(runs: Path, *words: str) -> subprocess.Popen:
    fold = f"-m cell fold --strip denim --policy triangular --json --runs {runs}"
    return subprocess.Popen(
        [sys.executable, *fold.split(), *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


@pytest.mark.slow
def test_a_killed_process_leaves_a_run_that_the_report_explains(tmp_path) -> None:
    process = start(tmp_path)
    folder = wait_for_state("FOLD", tmp_path, process)
    os.kill(process.pid, signal.SIGKILL)
    process.communicate()
    run = read_run(folder)
    assert run.died
    assert run.result is None
    assert len(run.ticks.t) > 100
    page = write_report(folder).read_text()
    assert "FOLD" in page
    assert "died" in page or "ended without" in page


@pytest.mark.slow
def test_ctrl_c_stops_under_control_and_is_recorded(tmp_path) -> None:
    process = start(tmp_path)
    folder = wait_for_state("FOLD", tmp_path, process)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=300)
    assert process.returncode == 130, err
    line = json.loads(out)
    assert line["outcome"] == "interrupted"
    assert line["exit_code"] == 130
    run = read_run(folder)
    assert run.result.outcome == "interrupted"
    ticks = run.ticks
    assert np.hypot(np.diff(ticks.x[-3:]), np.diff(ticks.z[-3:])).max() < 2e-4
