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

import cell.folding.fold
from cell.devices.devices import Devices
from cell.folding.batch import fold_all
from cell.record.run import read_run
from cell.report.page import write_report
from drivers.errors import SimulationNotFinite
from drivers.types import Frame
from tests.lab.faults.failing import FailingCamera, freeze, lose_all
from tests.support.children import wait_for_state
from tests.support.requests import request_for

STOP_TIME = 0.35  # s of the cell's time to brake from the fold's speed and settle


def black(frame: Frame, kept: Frame) -> Frame:
    noise = np.random.default_rng(frame.sequence).integers(0, 8, frame.image.shape, np.uint8)
    return replace(frame, image=noise)


def spoiled_fold(monkeypatch, runs: Path, change) -> tuple:
    open_cell = cell.folding.fold.open_cell
    monkeypatch.setattr(cell.folding.fold, "open_cell", lambda *a, **k: change(open_cell(*a, **k)))
    [result] = fold_all([request_for("denim", "triangular", runs)])
    return result, read_run(Path(result.run))


@pytest.mark.parametrize(
    ("spoil", "fault", "within", "still"),
    [
        (freeze, "image_frozen", 0.15, 0.15 + STOP_TIME),
        # it stands, and waits for an image, before it is named
        pytest.param(lose_all, "image_stale", 0.5, 0.35, marks=pytest.mark.slow),
        pytest.param(black, "low_confidence", 0.55, 0.55 + STOP_TIME, marks=pytest.mark.slow),
    ],
)
def test_bad_images_stop_the_arm(monkeypatch, tmp_path, spoil, fault, within, still) -> None:
    begin = 5.0  # in FOLD for a second

    def change(devices: Devices) -> Devices:
        camera, kept = FailingCamera(devices.camera), []

        def late(frame: Frame, _: Frame) -> Frame | None:
            if devices.clock.now() >= begin:
                return spoil(frame, *kept)
            kept[:] = [frame]
            return frame

        camera.spoil = late
        return replace(devices, camera=camera)

    result, run = spoiled_fold(monkeypatch, tmp_path, change)
    assert result.outcome == fault
    assert result.exit_code == 4
    events = {event.kind: event for event in run.events()}
    origin = next(e.t for e in run.events() if e.facts.get("state") == "PREFLIGHT")
    assert events["fault"].t - origin - begin < within
    assert result.duration - begin < within + STOP_TIME
    ticks = run.ticks
    steps = np.hypot(np.diff(ticks.x), np.diff(ticks.z))
    assert steps[-2:].max() < 2e-4
    assert steps[ticks.t[:-1] > origin + begin + still].max(initial=0.0) < 2e-4
    assert "FAULT" in [event.facts.get("state") for event in run.events()]


def test_a_strip_that_leaves_the_finite_numbers_is_a_named_fault(monkeypatch, tmp_path) -> None:
    def change(devices: Devices) -> Devices:
        world = devices.plant.twin.world
        step = world._step_strip

        def diverge(hand) -> None:
            if world.time > 5.0:
                raise SimulationNotFinite("chain", world.time)
            step(hand)

        monkeypatch.setattr(world, "_step_strip", diverge)
        return devices

    result, _ = spoiled_fold(monkeypatch, tmp_path, change)
    assert result.outcome == "simulation_not_finite"
    assert result.exit_code == 4


def test_grasping_nothing_is_a_named_fault(monkeypatch, tmp_path) -> None:
    def change(devices: Devices) -> Devices:
        monkeypatch.setattr(devices.plant.twin.world, "edge_within", lambda reach, lean: False)
        return devices

    result, _ = spoiled_fold(monkeypatch, tmp_path, change)
    assert result.outcome == "grasp_missed"
    assert result.exit_code == 4


def test_no_strip_on_the_desk_is_refused_before_the_grasp(monkeypatch, tmp_path) -> None:
    def change(devices: Devices) -> Devices:
        twin = devices.plant.twin
        scene = twin.world.scene
        monkeypatch.setattr(twin.world, "scene", lambda t: replace(scene(t), strip=False))
        return devices

    result, run = spoiled_fold(monkeypatch, tmp_path, change)
    assert result.outcome == "preflight_refused"
    assert result.exit_code == 3
    assert len(run.ticks.t) == 0


def start(runs: Path, *words: str) -> subprocess.Popen:
    command = [sys.executable, "-m", "cell", "fold", "--strip", "denim", "--policy", "triangular"]
    return subprocess.Popen(
        [*command, "--runs", str(runs), "--json", *words],
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
