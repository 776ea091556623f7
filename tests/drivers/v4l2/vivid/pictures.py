"""Checks of what is agreed with vivid: formats, sizes, rates, controls."""

import cv2
import numpy as np
import pytest

from calibration.board import BoardSettings, find_board
from drivers.v4l2.device import CameraRefused
from tests.drivers.v4l2.vivid.device import START, Vivid, frames
from tests.drivers.v4l2.vivid.screen import SIGNAL, filmed_screen

BAYER = ("RGGB", "GRBG", "BA81", "GBRG")


def check_every_format_shows_the_same_picture(vivid: Vivid) -> None:
    pictures = {}
    with vivid.having(osd_text_mode=2):
        for name in ("YUYV", "GREY", *BAYER):
            with vivid.camera(format=name) as camera:
                pictures[name] = frames(camera, 1)[0].image
    for name, image in pictures.items():
        assert image.shape == (360, 640, 3), f"{name}: {image.shape}"
        assert image.dtype == np.uint8
    bars = {
        name: image[100:140, 40:600:80].mean(axis=0) for name, image in pictures.items()
    }
    assert np.ptp(bars["YUYV"], axis=0).min() > 150, "the bars have no colours"
    for name in BAYER:
        worst = np.abs(bars[name] - bars["YUYV"]).max()
        assert worst < 25, f"{name} differs from YUYV by {worst:.0f} grey levels"
    grey = bars["YUYV"] @ (0.114, 0.587, 0.299)
    assert np.abs(bars["GREY"][:, 0] - grey).max() < 40


def check_what_the_camera_lacks_is_refused_with_its_offer(vivid: Vivid) -> None:
    for asked, words in (
        ({"width": 600, "height": 400}, "600x400 became.*YUYV 640x360"),
        ({"format": "MJPG"}, "MJPG 640x360 became"),
        ({"rate": 37.0}, "rate: 37 Hz became"),
    ):
        with pytest.raises(CameraRefused, match=words), vivid.camera(**asked):
            pass


def check_board_on_a_screen_is_found(vivid: Vivid) -> None:
    board = BoardSettings().board()
    sheet = board.generateImage((1280, 720), marginSize=40)
    with filmed_screen(vivid) as screen, vivid.camera(**SIGNAL) as camera:
        screen.show(cv2.cvtColor(sheet, cv2.COLOR_GRAY2BGR))
        image = frames(camera, 10)[-1].image
    found = find_board(image, cv2.aruco.CharucoDetector(board), board)
    assert found.corners == len(board.getChessboardCorners())


def check_rates_are_kept(vivid: Vivid) -> None:
    for width, height, rate in ((320, 180, 15.0), (640, 360, 15.0), (640, 360, 30.0)):
        with (
            # else its stamps lie ahead of their arrival
            vivid.having(timestamp_source=START),
            vivid.camera(width=width, height=height, rate=rate) as camera,
        ):
            first, *_, last = frames(camera, int(rate))
        found = (last.sequence - first.sequence) / (last.stamp - first.stamp)
        assert abs(found - rate) < 0.02 * rate, (
            f"{width}x{height}: {found:.2f} for {rate} Hz"
        )


def check_controls_are_locked_and_read_back(vivid: Vivid) -> None:
    with vivid.having(gain_automatic=1, brightness=128, gain=100):
        with vivid.camera(controls={"gain": 77, "brightness": 99}) as camera:
            locks = dict(camera.setup.locks)
        found = {name: vivid.controls()[name].value for name in locks}
    assert locks == found
    assert (locks["gain_automatic"], locks["gain"], locks["brightness"]) == (0, 77, 99)


def check_value_that_a_control_clamps_is_refused(vivid: Vivid) -> None:
    with (
        vivid.having(brightness=128),
        pytest.raises(
            CameraRefused, match=r"controls\.brightness.*999 became 255.*0 to 255"
        ),
        vivid.camera(controls={"brightness": 999}),
    ):
        pass
