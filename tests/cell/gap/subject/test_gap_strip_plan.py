"""`cell gap plan`: which runs it makes, and that one of them folds through images."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from cell.base.config.places import find_configs
from cell.setup.arm.run_settings import at_speed
from drivers.base.errors import ConfigurationError
from policies.experiments.standard import STANDARD


def test_a_speed_beyond_the_limits_is_refused() -> None:
    settings = find_configs(None).cell()
    assert at_speed(settings, 0.05).fold.speed == 0.05
    assert at_speed(settings, None) is settings
    with pytest.raises(ConfigurationError, match=r"fold: speed"):
        at_speed(settings, 1.0)


def test_the_command_says_what_it_would_do(tmp_path: Path) -> None:
    words = f"-m cell gap plan --strip denim --dry-run --runs {tmp_path}/runs"
    command = [sys.executable, *words.split()]
    texts = (command, [*command, "--json"])
    done = [
        subprocess.run(c, capture_output=True, text=True, check=True).stdout
        for c in texts
    ]
    lines, rows = done[0].splitlines(), list(map(json.loads, done[1].splitlines()))
    assert len(lines) == len(rows) == len(STANDARD) + 2
    assert lines[0].split()[1] == lines[-1].split()[1] == rows[-1]["name"] == "normal"
    assert not (tmp_path / "runs").exists()
