"""What `cell camera` says, without a camera and with one that a stand-in for the kernel
has.
"""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

import drivers.v4l2.device
from cell.base.devices.open import check_calibrated, check_drivers
from cell.record.film import FilmWriter
from drivers.v4l2.camera import UnusableDevice, list_cameras
from drivers.v4l2.settings import V4l2Settings
from tests.drivers.v4l2.fake_kernel import LINK, FakeKernel
from tests.support.commands import invoke
from tests.support.refusals import refusal
from tests.support.requests import CELL

REAL = CELL.with_drivers(camera="v4l2")


@pytest.fixture
def links(tmp_path: Path) -> Path:
    """Links as udev keeps them: a camera by id and by path, another one by path
    alone.
    """
    for name in ("video0", "video2"):
        (tmp_path / name).touch()
    for kind, name, node in (
        ("by-id", "usb-Test", "video0"),
        ("by-path", "pci-usb-1", "video0"),
        ("by-path", "pci-usb-2", "video2"),
    ):
        (tmp_path / kind).mkdir(exist_ok=True)
        (tmp_path / kind / name).symlink_to(tmp_path / node)
    return tmp_path


def test_device_that_cannot_be_opened_is_listed_with_the_reason(links: Path) -> None:
    first, _ = list_cameras(FakeKernel(), links)
    assert isinstance(first, UnusableDevice)
    assert "No such file" in first.problem


def test_no_camera_is_an_error_of_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("drivers.v4l2.camera._device_links", lambda *_: [])
    assert "plug one in" in str(invoke("camera").exception)


def test_listing_names_formats_controls_and_the_section_to_add(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(drivers.v4l2.device, "Kernel", FakeKernel)
    done = invoke(f"camera --device {LINK}")
    assert done.exit_code == 0
    assert "YUYV 64x48 at 60 Hz" in done.stdout
    assert (
        "exposure_time_absolute 157 (1 to 5000 in steps of 1; is inactive"
        in done.stdout
    )
    section = json.loads(done.stdout.rpartition("camera: ")[2])
    assert V4l2Settings.model_validate(section).device == LINK
    line = json.loads(invoke(f"camera --device {LINK} --json").stdout)
    assert line["camera"] == section


def test_cell_without_a_camera_section_says_what_to_add() -> None:
    with refusal(r"camera: is missing.*cell camera"):
        check_drivers(REAL)


def test_real_camera_without_a_calibration_is_refused_before_anything_opens() -> None:
    with refusal(r"calibration: is missing"):
        check_calibrated(REAL)
    check_calibrated(CELL)


def test_first_check_pins_the_view_and_later_ones_compare(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)

    def check(options: str = "") -> str:
        done = invoke(f"camera check {options}")
        return f"{done.exit_code} {done.stdout}"

    assert check() == "0 pinned: calibrations/view.png; call it again to compare\n"
    assert check().startswith("0 the camera stands where it stood: off by 0.")
    cv2.imwrite("other.png", np.roll(cv2.imread("calibrations/view.png"), 3, axis=1))
    told = check("--view other.png --picture motion.png --json")
    facts = json.loads(told.removeprefix("1 "))
    assert facts["pixels"] == pytest.approx(3, abs=0.3)
    assert facts["distance"] == pytest.approx(0.00177, abs=2e-4)
    assert cv2.imread("motion.png").shape == (720, 1280, 3)


def test_film_is_compared_with_its_first_image(tmp_path: Path) -> None:
    grain = np.random.default_rng(0).integers(0, 255, (72, 128, 3), np.uint8)
    image = cv2.resize(grain, None, fx=8, fy=8)
    for name, at_end in (("still.mp4", 0), ("nudged.mp4", 4)):
        with FilmWriter(tmp_path / name) as film:
            for second in range(4):
                film.add(second, np.roll(image, at_end * (second == 3), axis=0))
        done = invoke("camera check", tmp_path / name)
        assert done.exit_code == bool(at_end)
        assert f"off by {at_end}.0 px, allowed" in done.stdout
