"""`cell gap plan`: which runs it makes, and that one of them folds through images."""

import subprocess
import sys
from pathlib import Path

import pytest

from cell.arm.run_settings import at_speed
from cell.config.places import find_configs
from cell.devices.devices import DeviceSelection
from cell.folding.batch import fold_all
from cell.folding.request import Recording, Request
from cell.folding.standard_runs import standard_requests, went_as_planned
from cell.gap.subject.run_folders import find_runs
from cell.gap.subject.strip.runs import read_runs
from drivers.errors import ConfigurationError
from policies.experiments.standard import STANDARD
from tests.support.gap_strip_cases import denim
from tests.support.requests import request_for


def base(runs: Path, seed: int = 3) -> Request:
    record = Recording("none", truth=False)
    return request_for("denim", "", runs, choice=DeviceSelection(seed=seed), record=record)


def test_a_speed_beyond_the_limits_is_refused() -> None:
    settings = find_configs(None).cell()
    assert at_speed(settings, 0.05).fold.speed == 0.05
    assert at_speed(settings, None) is settings
    with pytest.raises(ConfigurationError, match=r"fold: speed"):
        at_speed(settings, 1.0)


def test_the_command_says_what_it_would_do(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "cell", "gap", "plan", "--strip", "denim", "--dry-run"]
    command += ["--runs", str(tmp_path / "runs")]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    lines = done.stdout.splitlines()
    assert len(lines) == len(STANDARD) + 2
    assert lines[0].split()[1] == lines[-1].split()[1] == "normal"
    assert not (tmp_path / "runs").exists()


@pytest.mark.long
def test_a_shaken_and_a_taut_run_are_folded_through_images_and_read(tmp_path: Path) -> None:
    wanted = [
        r for r in standard_requests(base(tmp_path))
        if r.policy in ("motion:early-shake", "motion:taut-lift")
    ]  # fmt: skip
    results = list(fold_all(wanted))
    assert all(went_as_planned(result) for result in results)
    assert {result.outcome for result in results} == {"layer_touch", "path_done"}
    runs = read_runs(find_runs([tmp_path]), denim())
    assert {run.condition for run in runs} == {
        "motion:early-shake at 0.1 m/s",
        "motion:taut-lift at 0.1 m/s",
    }
