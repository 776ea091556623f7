"""Commands of the cell with the kernel's virtual camera: minutes on an emulated machine."""

import json
from collections.abc import Mapping
from typing import Any

import pytest

from tests.drivers.camera.machine import beside_vivid

pytestmark = pytest.mark.long

MODULE = "tests.drivers.camera.vivid.commands"
LIMIT = 1800.0  # s
PROCESSOR = "Haswell"  # MuJoCo wants AVX


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Mapping[str, Any]]:
    """What each command said and returned, by its name."""
    folder = tmp_path_factory.mktemp("machine")
    lines = beside_vivid(folder, MODULE, seconds=LIMIT, processor=PROCESSOR)
    results = (json.loads(line) for line in lines if line.startswith("{"))
    return {result["name"]: result for result in results}


def test_camera_is_listed_with_its_modes_and_the_section_to_add(told) -> None:
    text, line = told["list"], told["list as json"]
    assert (text["code"], line["code"]) == (0, 0)
    assert "YUYV 640x360 at" in text["out"]
    assert "brightness" in text["out"]
    assert json.loads(line["out"])["camera"]["device"].startswith("/dev/v4l/by-id/")


def test_picture_is_taken_by_the_cell_file_and_by_name(told) -> None:
    line = json.loads(told["grab"]["out"])
    assert line["locks"]["brightness"] == 120
    assert line["measured_rate"] == pytest.approx(15.0, rel=0.1)
    assert told["grab by name"]["code"] == 0
    assert "640x360" in told["grab by name"]["out"]


def test_missing_camera_is_reported_in_a_line(told) -> None:
    absent = told["grab of none"]
    assert absent["code"] == 4
    assert absent["err"].startswith("cell: camera_lost: /dev/v4l/by-id/none: No such file")


def test_fold_opens_the_camera_and_preflight_refuses_the_picture(told) -> None:
    fold = told["fold"]
    assert "Traceback" not in fold["err"]
    assert fold["code"] == 3, fold["err"]
    assert json.loads(fold["out"])["outcome"] == "preflight_refused"
    assert "lay the strip along the x-axis" in fold["err"]
