"""The driver on a real kernel: on this host where vivid is loaded, else on an emulated machine."""

import json
import os
import subprocess
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

from tests.drivers.camera.machine import CHECKOUT, find_machine, python
from tests.drivers.camera.vivid.checks import CHECKS
from tests.drivers.camera.vivid.device import DRIVER

REQUIRED = "CELL_REQUIRE_DEVICES"  # 1: what is missing is a failure, as in CI
LIMIT = 240.0  # s until the machine counts as hung; it takes some 20 s on an idle host
COMMAND = python("-m", "tests.drivers.camera.vivid.checks")


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Mapping[str, Any]]:
    """What each check said, by its name."""
    return {result["check"]: result for result in _results(tmp_path_factory.mktemp("machine"))}


@pytest.mark.parametrize("name", sorted(CHECKS))
def test_driver_on_the_kernels_vivid(told: Mapping[str, Mapping[str, Any]], name: str) -> None:
    assert name in told, f"the run ended before this check; it said of {sorted(told)}"
    assert told[name]["problem"] is None, told[name]["problem"]


def _results(folder: Path) -> Iterator[Mapping[str, Any]]:
    for line in _lines(folder):
        if line.startswith("{"):
            yield json.loads(line)
        else:
            print(line)  # pytest shows it beside a failure


def _lines(folder: Path) -> list[str]:
    if DRIVER.exists() and os.access(DRIVER / "unbind", os.W_OK):
        done = subprocess.run(
            COMMAND, cwd=CHECKOUT, stdout=subprocess.PIPE, text=True, timeout=LIMIT, check=False
        )
        return done.stdout.splitlines()
    machine = find_machine()
    if isinstance(machine, str):
        if os.environ.get(REQUIRED) == "1":
            pytest.fail(machine)
        pytest.skip(machine)
    return list(machine.run(folder, COMMAND, seconds=LIMIT))
