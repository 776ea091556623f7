"""The twin's camera keeps the camera's times, shows the world at them, and draws
between ticks.
"""

from itertools import pairwise

import numpy as np
import pytest

from drivers.base.errors import Fault
from drivers.base.types import Frame
from drivers.twin.camera import PacedCamera, TwinCamera
from drivers.twin.renderer.looks import StripLook
from drivers.twin.renderer.renderer import Renderer
from drivers.twin.settings import CameraSettings
from drivers.twin.world import WorldState
from tests.support.rendered_cell import scene

SETTINGS = CameraSettings(width=320, height=240)
LOOK = StripLook((40, 60, 110), 0.001, 0.05)
ALWAYS = -1.0


class FixedClock:
    """A clock that a test sets."""

    def __init__(self) -> None:
        self.time = 0.0

    def now(self) -> float:
        return self.time

    def wait_until(self, time: float) -> None:
        raise AssertionError("a camera must not advance the world")


class RecordedWorld:
    """A strip whose end rises at 0.1 m/s; remembers the moments that it was asked
    for.
    """

    def __init__(self) -> None:
        self.asked: list[float] = []

    def scene(self, stamp: float) -> WorldState:
        self.asked.append(stamp)
        return scene("lifted", stamp, shift=(0.0, 0.1 * stamp))


@pytest.fixture
def clock() -> FixedClock:
    return FixedClock()


@pytest.fixture
def world() -> RecordedWorld:
    return RecordedWorld()


def connected(
    world: RecordedWorld, clock: FixedClock, latency: float = 0.0
) -> TwinCamera:
    camera = TwinCamera(
        world.scene, clock, SETTINGS, Renderer(SETTINGS, LOOK, 1), 1, latency
    )
    camera.connect()
    return camera


def test_frame_is_known_a_transport_delay_after_its_stamp(world, clock) -> None:
    camera = connected(world, clock)
    clock.time = 0.0199
    assert camera.read(ALWAYS, 0.0) is None
    clock.time = 0.0200
    frame = camera.read(ALWAYS, 0.0)
    assert (frame.sequence, frame.stamp, frame.arrival) == (0, 0.0, 0.02)


def test_stamps_are_multiples_of_the_period_however_late_one_reads(
    world, clock
) -> None:
    camera = connected(world, clock)
    for k in range(1, 400, 7):
        clock.time = k / 60 + SETTINGS.transport_delay + 1e-6
        frame = camera.read(ALWAYS, 0.0)
        assert frame.sequence == k
        assert frame.stamp == pytest.approx(k / 60, abs=1e-9)
        assert frame.arrival <= clock.now()


def test_half_of_the_frames_never_arrive_and_those_that_do_are_whole(
    world, clock
) -> None:
    settings = SETTINGS.model_copy(update={"lost": 0.5})
    poor = TwinCamera(world.scene, clock, settings, Renderer(settings, LOOK, 1), 1)
    poor.connect()
    got = []
    for turn in range(60):
        clock.time = 0.03 + turn / SETTINGS.rate
        frame = poor.read(got[-1].stamp if got else ALWAYS, 0.0)
        got += [] if frame is None else [frame]
    assert 20 <= len(got) <= 40
    assert all(now.sequence > before.sequence for before, now in pairwise(got))
    clock.time = got[-1].arrival
    whole = connected(world, clock).read(ALWAYS, 0.0)
    assert np.array_equal(whole.image, got[-1].image)


def test_stamp_is_the_middle_of_the_exposure(world, clock) -> None:
    camera = connected(world, clock)
    clock.time = 1.0
    frame = camera.read(ALWAYS, 0.0)
    assert np.mean(world.asked) == pytest.approx(frame.stamp)
    spread = SETTINGS.exposure * (1 - 1 / SETTINGS.sub_shapes)
    assert max(world.asked) - min(world.asked) == pytest.approx(spread)


def test_latency_shows_an_earlier_world_under_the_same_stamp(world, clock) -> None:
    clock.time = 1.0
    prompt, late = connected(world, clock), connected(world, clock, latency=0.05)
    frame = prompt.read(ALWAYS, 0.0)
    shown = np.mean(world.asked)
    world.asked.clear()
    delayed = late.read(ALWAYS, 0.0)
    assert (delayed.stamp, delayed.arrival) == (frame.stamp, frame.arrival)
    assert shown - np.mean(world.asked) == pytest.approx(0.05)
    assert not np.array_equal(frame.image, delayed.image)


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
        return Frame(
            stamp, stamp + 0.01, "made", self.calls // 2, np.zeros((2, 2, 3), np.uint8)
        )

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
