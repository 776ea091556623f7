"""The robot's server and model that others wrote, installed apart from the product."""

import os
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

from tests.support.rooms import ROOT

REQUIRED = "CELL_REQUIRE_DEVICES"  # 1: what is missing is a failure, as in CI
USUAL = Path.home() / ".cache/folding-cell/franky-sim"  # outside of the tests
INSTALLATION_LIMIT = 600.0  # s


@cache
def franky_sim_python() -> Path:
    """Python of the environment that holds franky-sim, made at the first call.

    Where it cannot be installed the test that asks is skipped; in CI it fails.
    """
    folder = os.environ.get("CELL_FRANKY_SIM", USUAL)
    words = ["bash", ROOT / ".ci/franky-sim", folder, sys.executable]
    try:
        done = subprocess.run(
            words,
            check=True,
            capture_output=True,
            text=True,
            timeout=INSTALLATION_LIMIT,
        )
    except (subprocess.CalledProcessError, subprocess.TimeoutExpired) as failed:
        if os.environ.get(REQUIRED) == "1":
            raise
        pytest.skip(f"franky-sim cannot be installed here: {failed}")
    return Path(done.stdout.strip())


def franky_sim_model() -> Path:
    """Path of the maker's arm with hand as a MuJoCo model, `fr3.xml` of franky-sim."""
    packages = franky_sim_python().parents[1] / "lib"
    (model,) = packages.glob("python*/site-packages/franky_sim/assets/fr3.xml")
    return model
