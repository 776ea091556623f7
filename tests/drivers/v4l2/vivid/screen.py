"""A screen that vivid's camera films: what is shown by its video output arrives at its
input.
"""

import mmap
import os
from collections.abc import Iterator
from contextlib import contextmanager
from fcntl import ioctl
from threading import Thread

import cv2

from drivers.base.types import Image
from drivers.v4l2.abi import (
    MMAP,
    PROGRESSIVE,
    Buffer,
    BufferRequest,
    Ioctl,
    Number,
)
from tests.drivers.v4l2.vivid.device import Vivid

OUTPUT = 2  # V4L2_BUF_TYPE_VIDEO_OUTPUT
HDMI = 1  # number of vivid's input that its output is plugged into
SELECT_INPUT = 0xC0045627  # VIDIOC_S_INPUT
BUFFERS = 3
# of the signal on vivid's HDMI, which has no other
SIGNAL = {"width": 1280, "height": 720, "rate": 60.0, "format": "YUYV"}


class Screen:
    """What vivid's video output shows, a picture (720, 1280, 3) in BGR at a time."""

    def __init__(self, fd: int) -> None:
        self._fd = fd
        self._showing = True
        ioctl(fd, Ioctl.REQBUFS, BufferRequest(count=BUFFERS, type=OUTPUT, memory=MMAP))
        self._buffers = [self._mapped(index) for index in range(BUFFERS)]
        self._picture = bytes(len(self._buffers[0]))
        self._thread = Thread(target=self._run)

    def show(self, image: Image) -> None:
        """Show `image` until another follows."""
        self._picture = cv2.cvtColor(image, cv2.COLOR_BGR2YUV_YUY2).tobytes()

    def __enter__(self) -> "Screen":
        for index in range(BUFFERS):
            self._queue(index)
        ioctl(self._fd, Ioctl.STREAMON, Number(OUTPUT))
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._showing = False
        self._thread.join()
        os.close(self._fd)

    def _mapped(self, index: int) -> mmap.mmap:
        buffer = Buffer(index=index, type=OUTPUT, memory=MMAP)
        ioctl(self._fd, Ioctl.QUERYBUF, buffer)
        return mmap.mmap(self._fd, buffer.length, offset=buffer.m.offset)

    def _queue(self, index: int) -> None:
        picture = self._picture
        self._buffers[index][:] = picture
        buffer = Buffer(index=index, type=OUTPUT, memory=MMAP, field=PROGRESSIVE)
        buffer.bytesused = len(picture)
        ioctl(self._fd, Ioctl.QBUF, buffer)

    def _run(self) -> None:
        while self._showing:
            shown = Buffer(type=OUTPUT, memory=MMAP)
            ioctl(self._fd, Ioctl.DQBUF, shown)
            self._queue(shown.index)


@contextmanager
def filmed_screen(vivid: Vivid) -> Iterator[Screen]:
    """A dark screen before the camera, which films its test picture again
    afterwards.
    """
    with vivid.having(loop_video=1, osd_text_mode=2):
        _select(vivid, HDMI)
        try:
            with Screen(os.open(vivid.node("vid-out"), os.O_RDWR)) as screen:
                yield screen
        finally:
            _select(vivid, 0)


def _select(vivid: Vivid, number: int) -> None:
    with vivid.device() as device:
        ioctl(device.fd, SELECT_INPUT, Number(number))
