"""Images are drawn in one tick and delivered in the next."""

import numpy as np
import pytest

from drivers.errors import Fault
from drivers.twin.camera import PacedCamera
from drivers.types import Frame


class Drawing:
    """A camera with one frame every other call; counts what it draws."""

    rate = 50.0

    def __init__(self) -> None:
        self.calls = self.drawn = 0
        self.open = False

    def connect(self) -> None:
        self.open = True

    def read(self, after: float, timeout: float) -> Frame | None:
        if not self.open:
            raise Fault("camera_closed", "closed")
        self.calls += 1
        stamp = 0.02 * (self.calls // 2)
        if stamp <= after:
            return None
        self.drawn += 1
        return Frame(stamp, stamp + 0.01, "made", self.calls // 2, np.zeros((2, 2, 3), np.uint8))

    def close(self) -> None:
        self.open = False


def begun(inner: Drawing) -> PacedCamera:
    """A camera that has delivered its first image, at once."""
    camera = PacedCamera(inner)
    camera.connect()
    while camera.read(0.0, timeout=0.0) is None:
        continue
    return camera


def test_no_call_both_draws_and_delivers_an_image() -> None:
    inner = Drawing()
    camera, after, delivered = begun(inner), 0.02, 1
    for _ in range(40):
        before = inner.drawn
        frame = camera.read(after, timeout=0.0)
        if frame is not None:
            assert inner.drawn == before
            assert frame.stamp > after
            after, delivered = frame.stamp, delivered + 1
    assert delivered == pytest.approx(inner.drawn, abs=1)
    assert delivered > 8


def test_what_was_drawn_before_is_not_delivered_once_it_is_too_old() -> None:
    camera = begun(Drawing())
    while camera._drawn is None:
        assert camera.read(0.02, timeout=0.0) is None
    assert camera.read(1.0, timeout=0.0) is None


def test_a_closed_camera_delivers_nothing_of_before() -> None:
    camera = begun(Drawing())
    while camera._drawn is None:
        camera.read(0.02, timeout=0.0)
    camera.close()
    with pytest.raises(Fault, match="closed"):
        camera.read(0.0, timeout=0.0)


def test_one_who_comes_late_is_not_kept_waiting() -> None:
    inner = Drawing()
    camera = begun(inner)
    inner.calls = 19
    frame = camera.read(0.05, timeout=0.0)
    assert frame is not None
    assert frame.stamp == 0.2
