"""Robot and camera of a real cell: nothing is simulated beside them, and both are on
one clock.
"""

import pytest

from cell.base.devices.devices import Trial
from cell.base.devices.open import open_cell
from drivers.base.clock import WallClock
from drivers.v4l2.camera import V4l2Camera
from drivers.v4l2.settings import V4l2Settings
from tests.support.requests import CELL, DENIM

pytest.importorskip("pylibfranka", reason="the robot's library is not installed")

CAMERA = {"device": "/dev/v4l/by-id/usb-camera", "format": "YUYV"}
CAMERA |= {"width": 1280, "height": 720, "rate": 30.0}
SETTINGS = CELL.model_copy(update={"camera": V4l2Settings.model_validate(CAMERA)})


def test_beside_a_real_robot_and_camera_no_strip_is_simulated() -> None:
    fci = SETTINGS.fci.model_copy(update={"address": "127.0.0.9"})
    settings = SETTINGS.model_copy(update={"fci": fci}).with_drivers("fci", "v4l2")
    devices = open_cell(settings, DENIM, Trial(), calibrating=False)
    assert isinstance(devices.clock, WallClock)
    assert isinstance(devices.camera, V4l2Camera)
    assert devices.plant is None
    assert devices.real_time
    assert devices.camera_identity == settings.camera.identity


def test_a_twin_waits_for_images_and_a_real_camera_does_not() -> None:
    for camera, real_time in (("twin", False), ("v4l2", True)):
        settings = SETTINGS.with_drivers("twin", camera)
        assert (
            open_cell(settings, DENIM, Trial(), calibrating=False).real_time
            is real_time
        )
