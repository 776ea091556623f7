"""Runs a module of this checkout beside vivid: on this host, or on an emulated machine."""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.drivers.camera.machine import CHECKOUT, find_machine
from tests.drivers.camera.vivid.device import DRIVER

REQUIRED = "CELL_REQUIRE_DEVICES"  # 1: what is missing is a failure, as in CI


def beside_vivid(
    folder: Path, module: str, *, seconds: float, processor: str = "Nehalem"
) -> Iterator[str]:
    """Lines that `module` writes; the test is skipped, or fails, where vivid cannot be had.

    The host's own vivid is used where it is loaded and may be unbound; `folder` is for the boot.
    """
    command = [sys.executable, "-m", module]
    if os.access(DRIVER / "unbind", os.W_OK):
        done = subprocess.run(
            command, cwd=CHECKOUT, stdout=subprocess.PIPE, text=True, timeout=seconds, check=False
        )
        yield from done.stdout.splitlines()
        return
    machine = find_machine()
    if isinstance(machine, str):
        if os.environ.get(REQUIRED) == "1":
            pytest.fail(machine)
        pytest.skip(machine)
    yield from machine.run(folder, command, seconds=seconds, processor=processor)
