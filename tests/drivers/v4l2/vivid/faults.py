"""Checks of faults and of what comes after them."""

import os
import threading
import time

import pytest

from drivers.v4l2.abi import Control, Ioctl
from drivers.v4l2.device import CameraBusy, CameraFaulty, CameraLost, CameraStalled
from tests.drivers.v4l2.vivid.device import (
    ALWAYS,
    DRIVER,
    Vivid,
    frames,
    read_on,
    recovered,
    trouble,
)

UNPLUG = 0.05  # s until a read must have said that the camera is gone


def check_stall_is_told_and_ends_with_the_next_frame(vivid: Vivid) -> None:
    with vivid.camera(stall=1.0) as camera:
        last = frames(camera, 3)[-1]
        with vivid.having(percentage_of_dropped_buffers=100):
            with pytest.raises(CameraStalled, match="no frame for"):
                read_on(camera)
            with pytest.raises(CameraStalled):
                camera.read(ALWAYS, 0.0)
        frame = recovered(camera)
        assert frame.sequence > last.sequence
        assert camera.counts.restarts >= 1


def check_fatal_error_is_told_and_the_stream_starts_anew(vivid: Vivid) -> None:
    with vivid.camera() as camera:
        last = frames(camera, 3)[-1]
        vivid.set(inject_fatal_streaming_error=1)
        with pytest.raises(CameraFaulty, match="Input/output error"):
            read_on(camera)
        assert recovered(camera).sequence > last.sequence
        assert camera.counts.restarts == 1


def check_buffers_refused_leave_nothing_held(vivid: Vivid) -> None:
    for fault in ("inject_vidioc_reqbufs_error", "inject_vidioc_streamon_error"):
        vivid.set(**{fault: 1})
        with pytest.raises(CameraFaulty, match="Invalid argument"), vivid.camera():
            pass
        with vivid.camera() as camera:
            frames(camera, 2)


def check_buffer_that_is_not_taken_back_is_told(vivid: Vivid) -> None:
    with vivid.camera() as camera:
        frames(camera, 3)
        vivid.set(inject_vidioc_qbuf_error=1)
        with pytest.raises(CameraFaulty, match="giving a buffer back"):
            read_on(camera)
        recovered(camera)


def check_unplug_in_mid_read_is_told_within_50_ms(vivid: Vivid) -> None:
    pulled: list[float] = []

    def pull() -> None:
        vivid.unplug()
        pulled.append(time.monotonic())
        button.kernel.ioctl(button.fd, Ioctl.S_CTRL, press)

    delays = []
    for _ in range(3):
        with vivid.camera() as camera:
            frames(camera, 2)
            with vivid.device() as button:
                number = vivid.controls()["disconnect"].number
                press = Control(id=number, value=1)
                timer = threading.Timer(0.1, pull)
                timer.start()
                with pytest.raises(CameraLost, match="cell camera"):
                    read_on(camera)
                told = time.monotonic()
                timer.join()
            delays.append(told - pulled.pop())
        vivid.plug()
    assert sorted(delays)[1] < UNPLUG, f"{[f'{1e3 * d:.0f} ms' for d in delays]}"


def check_replugged_camera_is_set_up_again_and_delivers(vivid: Vivid) -> None:
    with (
        vivid.having(brightness=128),
        vivid.camera(controls={"brightness": 99}) as camera,
    ):
        last = frames(camera, 3)[-1]
        vivid.unplug()
        vivid.set(disconnect=1)
        told = [str(error) for error in trouble(camera, 0.5)]
        assert told, "the unplug was not told"
        assert "No such file" in told[-1], told[-1]
        vivid.set(brightness=50)
        vivid.plug()
        frame = recovered(camera)
        assert frame.sequence > last.sequence
        assert frame.stamp > last.stamp
        assert vivid.controls()["brightness"].value == 99


def check_driver_taken_away_is_a_lost_camera(vivid: Vivid) -> None:
    with vivid.camera() as camera:
        last = frames(camera, 3)[-1]
        vivid.unplug()
        (DRIVER / "unbind").write_text("vivid.0")
        with pytest.raises(CameraLost):
            read_on(camera)
        (DRIVER / "bind").write_text("vivid.0")
        vivid.plug()
        assert recovered(camera).sequence > last.sequence


def check_second_user_is_named(vivid: Vivid) -> None:
    ready, done = os.pipe(), os.pipe()
    child = os.fork()
    if child == 0:
        try:
            with vivid.camera() as camera:
                frames(camera, 1)
                os.write(ready[1], b"!")
                os.read(done[0], 1)
        finally:
            os._exit(0)
    os.close(ready[1])
    assert os.read(ready[0], 1), "the other process has no camera"
    try:
        with (
            pytest.raises(
                CameraBusy, match=rf"\(process {child}\).*close that program"
            ),
            vivid.camera(),
        ):
            pass
    finally:
        os.write(done[1], b"!")
        os.waitpid(child, 0)
    with vivid.camera() as camera:
        frames(camera, 1)
