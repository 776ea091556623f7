"""What the driver asks of a camera and holds against its answer."""

import numpy as np
import pytest
from pydantic import ValidationError

from drivers.v4l2.device import CameraRefused, users_of
from drivers.v4l2.formats import PictureFormat
from drivers.v4l2.settings import V4l2Settings
from tests.drivers.v4l2.fake_kernel import LINK, FakeKernel, connected


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"format": "RGGB"}, "format: RGGB 64x48 became YUYV 64x48"),
        ({"rate": 30.0}, "rate: 30 Hz became 60 Hz; allowed: YUYV 64x48 at 60"),
        (
            {"controls": {"brightness": 300}},
            "brightness: 300 became 255; allowed: 0 to 255",
        ),
        (
            {"controls": {"zoom": 1}},
            "controls.zoom: unknown; allowed: auto_exposure, brightness",
        ),
    ],
)
def test_setting_that_the_camera_changes_is_refused(changed: dict, said: str) -> None:
    with pytest.raises(CameraRefused, match=said), connected(FakeKernel(), **changed):
        pass


# one of two fields, both of them, alternating
@pytest.mark.parametrize("field", [2, 3, 4, 8, 9])
def test_interlaced_video_is_refused(field: int) -> None:
    kernel = FakeKernel()
    kernel.field = field
    with pytest.raises(CameraRefused, match="interlaced"), connected(kernel):
        pass


def test_automatics_are_switched_off_before_their_controls_are_locked() -> None:
    wanted = {"exposure_time_absolute": 40}
    with connected(FakeKernel(), controls=wanted) as camera:
        setup = camera.setup
    assert setup.locks == {
        "auto_exposure": 1,
        "exposure_dynamic_framerate": 0,
        "white_balance_automatic": 0,
        **wanted,
    }
    assert setup.shutter.exposure == pytest.approx(0.004)


def test_control_that_an_automatic_holds_is_refused() -> None:
    wanted = {"auto_exposure": 3, "exposure_time_absolute": 40}
    refused = pytest.raises(CameraRefused, match="exposure_time_absolute: is inactive")
    with refused, connected(FakeKernel(), controls=wanted):
        pass


def test_device_by_number_is_refused() -> None:
    with pytest.raises(ValidationError, match="device"):
        V4l2Settings(device="/dev/video0")


def test_identity_follows_size_and_locks() -> None:
    plain = V4l2Settings(device=LINK)
    assert plain.identity == V4l2Settings(device=LINK, stall=1.0).identity
    assert (
        plain.identity != plain.model_copy(update={"controls": {"focus": 3}}).identity
    )


def test_lines_longer_than_the_picture_are_cut() -> None:
    padded = np.zeros((4, 12), np.uint8)
    padded[:, :8] = 77
    image = PictureFormat("GREY", 8, 4, 12, 30.0).decode(padded.ravel())
    assert image.shape == (4, 8, 3)
    assert (image == 77).all()


def test_user_of_a_device_is_named(tmp_path) -> None:
    device = tmp_path / "video0"
    device.touch()
    process = tmp_path / "41"
    (process / "fd").mkdir(parents=True)
    (process / "comm").write_text("cheese\n")
    (process / "fd" / "3").symlink_to(device)
    assert users_of(str(device), tmp_path) == "cheese (process 41)"
    assert "hidden" in users_of(str(tmp_path / "other"), tmp_path)
