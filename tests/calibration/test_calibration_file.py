"""The calibration file: whole, checked, refused in one line."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from calibration.calibration import (
    Calibration,
    change_calibration,
    load_calibration,
    save_calibration,
)
from drivers.base.errors import ConfigurationError
from tests.cell.conftest import straight_camera


@pytest.fixture
def calibration() -> Calibration:
    return straight_camera(
        residual_mm=0.12, date="2026-11-20T03:15:00Z", camera="twin-1", latency=0.02
    )


def test_saved_calibration_loads_equal(
    calibration: Calibration, tmp_path: Path
) -> None:
    path = tmp_path / "deep" / "calibration.yaml"
    save_calibration(calibration, path)
    read = load_calibration(path)
    assert read.id == calibration.id
    assert read.date == "2026-11-20T03:15:00Z"
    assert (read.latency, read.residual_mm, read.camera) == (0.02, 0.12, "twin-1")
    pixels = np.array([[100.0, 50.0], [1200.0, 700.0]])
    assert np.array_equal(read.to_plane(pixels), calibration.to_plane(pixels))
    assert [p.name for p in path.parent.iterdir()] == ["calibration.yaml"]


def test_id_is_of_the_content_but_not_of_the_date(calibration: Calibration) -> None:
    assert change_calibration(calibration, date="2031-01-01").id == calibration.id
    assert change_calibration(calibration, latency=0.03).id != calibration.id


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"latency": 0.5}, "id: is .* the file was changed by hand"),
        ({"latency": "late"}, "latency: "),
        ({"homograpy": 1}, "homograpy: unknown key.*; allowed here: .*homography"),
        ({"schema": 2}, "schema: is 2, this version reads 1"),
    ],
)
def test_changed_file_is_refused_in_one_line(
    calibration: Calibration, tmp_path: Path, change: dict[str, object], message: str
) -> None:
    path = tmp_path / "calibration.yaml"
    save_calibration(calibration, path)
    path.write_text(yaml.safe_dump(yaml.safe_load(path.read_text()) | change))
    with pytest.raises(ConfigurationError, match=message) as caught:
        load_calibration(path)
    assert "\n" not in str(caught.value)
