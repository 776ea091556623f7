"""The implementations that the contracts run over: a new driver is one more entry
here.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

import drivers.base.clock
from cell.base.config.places import find_configs
from cell.base.devices.devices import Trial
from cell.base.devices.open import open_cell
from cell.base.devices.rig_correction import CorrectedArm
from drivers.base.clock import WallClock
from drivers.base.protocols import Arm, Camera, Clock, Hand
from drivers.base.types import Pose
from drivers.strip.describe import load_strip
from drivers.strip.model import Rig
from drivers.twin.clock import RealTimeClock, TwinClock
from drivers.twin.open import Twin, open_twin
from drivers.twin.settings import CameraSettings, TwinSettings
from drivers.v4l2.camera import V4l2Camera
from drivers.v4l2.settings import V4l2Settings
from tests.drivers.v4l2.fake_kernel import LINK, FakeKernel

DENIM = Path(__file__).parents[2] / "configs" / "strips" / "denim.yaml"


@dataclass(frozen=True)
class Bench:
    """Devices on a clock, the arm connected where it is only needed to move the hand.

    `edge` is where the hand finds a strip; `accuracy` [m, rad] is how well the arm
    measures.
    """

    clock: Clock
    arm: Arm
    hand: Hand
    camera: Camera | None
    edge: Pose
    accuracy: float
    close: Callable[[], None] = lambda: None


class StillTime:
    """The time module of a machine on which only sleeping passes the time."""

    def __init__(self) -> None:
        self.seconds = 1234.5

    def monotonic(self) -> float:
        return self.seconds

    def sleep(self, seconds: float) -> None:
        self.seconds += seconds


def _twin() -> Twin:
    settings = TwinSettings(camera=CameraSettings(width=320, height=240))
    return open_twin(settings, load_strip(DENIM), seed=0)


def _twin_bench() -> Bench:
    twin = _twin()
    return Bench(
        twin.clock,
        twin.arm,
        twin.hand,
        twin.camera,
        edge=Pose(0.6, 0.0, 0.0),
        accuracy=5e-4,
    )


def _corrected_bench() -> Bench:
    twin = _twin_bench()
    rig = Rig(grip_x=0.004, grip_z=-0.002, grip_tilt=0.05)
    return replace(twin, arm=CorrectedArm(twin.arm, twin.hand, rig))


def _fci_bench() -> Bench:
    """The robot's own library in a process of its own, against the robot's protocol."""
    pytest.importorskip("pylibfranka", reason="the robot's library is not installed")
    settings = find_configs(None).cell().with_drivers("fci")
    camera = CameraSettings(width=320, height=240)
    settings = settings.model_copy(
        update={"twin": settings.twin.model_copy(update={"camera": camera})}
    )
    devices = open_cell(settings, load_strip(DENIM), Trial(), calibrating=False)
    edge = Pose(0.6, 0.0, 0.0)
    bench = Bench(
        devices.clock, devices.arm, devices.hand, devices.camera, edge, accuracy=1e-5
    )
    return replace(bench, close=devices.close)


BENCHES: dict[str, Callable[[], Bench]] = {
    "twin": _twin_bench,
    "corrected": _corrected_bench,
    "fci": _fci_bench,
}
CLOCKS: dict[str, Callable[[], Clock]] = {
    "twin": TwinClock,
    "wall": WallClock,
    "real time": lambda: RealTimeClock(TwinClock()),
}


@pytest.fixture(params=sorted(BENCHES))
def bench(request: pytest.FixtureRequest) -> Iterator[Bench]:
    made = BENCHES[request.param]()
    yield made
    made.arm.close()
    if made.camera is not None:
        made.camera.close()
    made.close()


@dataclass(frozen=True)
class CameraBench:
    """A camera and the clock that its frames come by."""

    clock: Clock
    camera: Camera


def _twin_camera() -> CameraBench:
    twin = _twin()
    return CameraBench(twin.clock, twin.camera)


def _v4l2_camera() -> CameraBench:
    kernel = FakeKernel()
    settings = V4l2Settings(device=LINK, width=64, height=48, rate=60.0)
    return CameraBench(kernel, V4l2Camera(settings, kernel, kernel))


CAMERAS: dict[str, Callable[[], CameraBench]] = {
    "twin": _twin_camera,
    "v4l2": _v4l2_camera,
}


@pytest.fixture(params=sorted(CAMERAS))
def camera_bench(request: pytest.FixtureRequest) -> Iterator[CameraBench]:
    made = CAMERAS[request.param]()
    yield made
    made.camera.close()


@pytest.fixture(params=sorted(CLOCKS))
def clock(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Clock:
    monkeypatch.setattr(drivers.base.clock, "time", StillTime())
    return CLOCKS[request.param]()
