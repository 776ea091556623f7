"""What the driver does when the camera fails, on a kernel that fails as it is told."""

import errno
import math
from collections.abc import Iterator
from contextlib import suppress

import cv2
import numpy as np
import pytest

from drivers.base.errors import CellError
from drivers.v4l2.abi import Ioctl
from drivers.v4l2.camera import V4l2Camera
from drivers.v4l2.device import (
    CameraBusy,
    CameraFaulty,
    CameraLost,
    CameraRefused,
    CameraStalled,
)
from drivers.v4l2.session import CameraFrame, StampSource
from tests.drivers.v4l2.fake_kernel import FakeKernel, connected

ALWAYS = -math.inf


@pytest.fixture
def kernel() -> FakeKernel:
    return FakeKernel()


@pytest.fixture
def camera(kernel: FakeKernel) -> Iterator[V4l2Camera]:
    with connected(kernel) as camera:
        go_on(kernel, 0.1)
        yield camera


def go_on(kernel: FakeKernel, seconds: float) -> None:
    kernel.wait_until(kernel.now() + seconds)


def newest(camera: V4l2Camera) -> CameraFrame | None:
    return camera.read(ALWAYS, 0.0)


def assert_fresh(kernel: FakeKernel, camera: V4l2Camera) -> None:
    assert kernel.now() - newest(camera).stamp < 2 / 60


def test_corrupt_and_short_frames_are_counted_and_never_delivered(
    kernel, camera
) -> None:
    before = newest(camera)
    kernel.faults.corrupt, kernel.faults.short = {kernel.counter}, {kernel.counter + 1}
    go_on(kernel, 2 / 60)
    assert camera.read(before.stamp, 0.0) is None
    go_on(kernel, 1 / 60)
    assert camera.read(before.stamp, 0.0).sequence == before.sequence + 3
    assert camera.counts.corrupt == 2


def test_only_corrupt_frames_are_a_fault(kernel, camera) -> None:
    kernel.faults.corrupt = set(range(1000))
    go_on(kernel, 0.6)
    with pytest.raises(CameraFaulty, match="corrupt"):
        newest(camera)


def test_pause_of_the_reader_leaves_no_old_frame(kernel, camera) -> None:
    go_on(kernel, 0.5)
    assert_fresh(kernel, camera)
    assert camera.counts.missing == 0


def test_stall_is_reported_until_a_frame_arrives(kernel, camera) -> None:
    kernel.faults.all_dropped = True
    go_on(kernel, 0.4)
    newest(camera)
    go_on(kernel, 0.2)
    for _ in range(2):
        with pytest.raises(CameraStalled, match=r"no frame for 0\.5"):
            newest(camera)
    kernel.faults.all_dropped = False
    go_on(kernel, 0.3)
    with suppress(CameraStalled):
        newest(camera)
    assert_fresh(kernel, camera)


def test_a_closed_camera_keeps_no_buffer_of_the_driver(kernel, camera) -> None:
    camera.close()
    assert kernel._buffers == []


def test_poll_error_without_a_frame_does_not_spin(kernel, camera) -> None:
    kernel.faults.stuck = True
    waits = kernel.waits
    go_on(kernel, 2.0)
    with pytest.raises(CameraFaulty, match="poll"):
        newest(camera)
    assert kernel.waits - waits < 150
    kernel.faults.stuck = False


def test_other_camera_at_the_link_is_refused_by_name(kernel, camera) -> None:
    kernel.unplug()
    kernel.size = (32, 24)
    kernel.plug()
    go_on(kernel, 0.5)
    with pytest.raises(CameraRefused, match="became YUYV 32x24"):
        newest(camera)


@pytest.mark.parametrize(
    ("request_", "number", "kind"),
    [
        (Ioctl.S_FMT, errno.EBUSY, CameraBusy),
        (Ioctl.REQBUFS, errno.EBUSY, CameraBusy),
        (Ioctl.REQBUFS, errno.ENOMEM, CameraFaulty),
        (Ioctl.QUERYBUF, errno.EINVAL, CameraFaulty),
        (Ioctl.QBUF, errno.EIO, CameraFaulty),
        (Ioctl.STREAMON, errno.EIO, CameraFaulty),
        (Ioctl.STREAMON, errno.ENODEV, CameraLost),
        (Ioctl.QUERYCAP, errno.ENOTTY, CameraRefused),
        (Ioctl.QUERYCAP, errno.ENXIO, CameraLost),
        (Ioctl.QUERYCAP, errno.ENOENT, CameraLost),
        (Ioctl.S_CTRL, errno.EIO, CameraFaulty),
    ],
)
def test_failed_connect_is_named_and_leaves_nothing_held(
    kernel, request_: Ioctl, number: int, kind: type[CellError]
) -> None:
    kernel.fail(request_, number)
    with pytest.raises(kind, match="Test_Camera"), connected(kernel):
        pass
    with connected(kernel) as camera:
        go_on(kernel, 0.2)
        assert newest(camera) is not None


def test_stamps_of_another_time_are_replaced_and_said(kernel, camera) -> None:
    for ahead in (0.5, -3.0, 4e9):
        kernel.faults.ahead = ahead
        go_on(kernel, 0.1)
        frame = newest(camera)
        assert frame.stamp_source is StampSource.DEQUEUE
        assert 0 < frame.arrival - frame.stamp < 0.02
    assert camera.counts.restamped >= 15


def test_counter_that_stands_still_loses_no_frame(kernel, camera) -> None:
    first = newest(camera)
    kernel.faults.repeat = True
    go_on(kernel, 0.2)
    assert newest(camera).sequence > first.sequence + 8
    assert camera.counts.missing == 0
    assert camera.counts.repeated >= 8


def test_broken_jpeg_is_counted_and_never_delivered(kernel) -> None:
    image = np.full((48, 64, 3), (40, 120, 200), np.uint8)
    whole = cv2.imencode(".jpg", image)[1].tobytes()
    kernel.jpeg = whole
    with connected(kernel, format="MJPG") as camera:
        go_on(kernel, 0.1)
        frame = newest(camera)
        assert np.abs(frame.image.astype(int) - image).max() < 12
        cut_off, blank = whole[: len(whole) // 2], b"\0" * len(whole)
        for broken in (cut_off, blank, whole[:2] + whole[-2:]):
            kernel.jpeg = broken
            go_on(kernel, 1 / 60)
            assert camera.read(frame.stamp, 0.0) is None
        assert camera.counts.corrupt == 3
