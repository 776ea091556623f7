"""The driver on a real kernel: on this host where vivid is loaded, else on an emulated
machine.
"""

import json
from collections.abc import Mapping
from typing import Any

import pytest

from tests.drivers.v4l2.machine import beside_vivid
from tests.drivers.v4l2.vivid.checks import CHECKS

pytestmark = pytest.mark.slow  # an emulated machine starts
LIMIT = 400.0  # s until the machine counts as hung; it needs 30 s of a processor


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Mapping[str, Any]]:
    """What each check said, by its name; other lines are shown beside a failure."""
    results = {}
    folder = tmp_path_factory.mktemp("machine")
    for line in beside_vivid(folder, "tests.drivers.v4l2.vivid.checks", seconds=LIMIT):
        if line.startswith("{"):
            result = json.loads(line)
            results[result["check"]] = result
        else:
            print(line)
    return results


@pytest.mark.parametrize("name", sorted(CHECKS))
def test_driver_on_the_kernels_vivid(
    told: Mapping[str, Mapping[str, Any]], name: str
) -> None:
    assert name in told, f"the run ended before this check; it said of {sorted(told)}"
    assert told[name]["problem"] is None, told[name]["problem"]
