"""Reading frames and waiting for trouble, as the checks do it."""

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager

from drivers.camera.camera import V4l2Camera
from drivers.camera.device import CameraLost
from drivers.camera.frame import CameraFrame
from drivers.errors import CellError

ALWAYS = -math.inf
PATIENCE = 4.0  # s until a frame must have come


def frames(camera: V4l2Camera, count: int) -> list[CameraFrame]:
    """The next `count` frames."""
    seen: list[CameraFrame] = []
    after = ALWAYS
    while len(seen) < count:
        frame = camera.read(after, PATIENCE)
        assert frame is not None, f"no frame in {PATIENCE} s"
        seen.append(frame)
        after = frame.stamp
    return seen


@contextmanager
def raising(kind: type[CellError], *words: str) -> Iterator[None]:
    """Whatever runs here raises `kind`, and its message holds `words`."""
    said = None
    try:
        yield
    except kind as error:
        said = str(error)
    assert said is not None, f"{kind.__name__} was not raised"
    missing = [word for word in words if word not in said]
    assert not missing, f"{missing} not in: {said}"


def read_on(camera: V4l2Camera, seconds: float = 10.0) -> None:
    """Read frames as they come, until an error or for `seconds`."""
    end, after = time.monotonic() + seconds, ALWAYS
    while time.monotonic() < end:
        frame = camera.read(after, 0.5)
        after = after if frame is None else frame.stamp


def recovered(camera: V4l2Camera, seconds: float = 8.0) -> CameraFrame:
    """The first frame after trouble, which may be told until then."""
    end = time.monotonic() + seconds
    begun = camera.counts.arrived
    while time.monotonic() < end:
        try:
            frame = camera.read(ALWAYS, 0.1)
        except CellError:
            time.sleep(0.02)
            continue
        if frame is not None and camera.counts.arrived > begun:
            return frame
    raise AssertionError(f"not recovered after {seconds} s: {camera.counts}")


def trouble(camera: V4l2Camera, seconds: float) -> list[CameraLost]:
    """Every time that the camera says that it is lost, asked for `seconds`."""
    told = []
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        try:
            camera.read(ALWAYS, 0.05)
        except CameraLost as error:
            told.append(error)
            time.sleep(0.02)
    return told
