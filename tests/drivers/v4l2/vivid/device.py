"""The kernel's virtual camera with the faults that it can play, and the reading of its
frames.
"""

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from drivers.base.clock import WallClock
from drivers.base.errors import CellError
from drivers.v4l2.abi import Control, Ioctl
from drivers.v4l2.camera import V4l2Camera
from drivers.v4l2.controls import CameraControl, controls_of
from drivers.v4l2.device import CameraLost, Device, Kernel
from drivers.v4l2.session import CameraFrame
from drivers.v4l2.settings import V4l2Settings

END, START = 0, 1  # vivid's menu of timestamp sources
LINKS = Path("/dev/v4l/by-id")
DRIVER = Path("/sys/bus/platform/drivers/vivid")
ALWAYS = -math.inf
PATIENCE = 4.0  # s until a frame must have come


class Vivid:
    """vivid behind a link of its own, as udev would make one. Controls return to their
    defaults.
    """

    def __init__(self) -> None:
        self.link = LINKS / "usb-vivid-test-camera"
        LINKS.mkdir(parents=True, exist_ok=True)
        self.plug()

    def settings(self, **changed: object) -> V4l2Settings:
        """640x360 YUYV at 30 Hz unless `changed`."""
        usual = {"device": str(self.link), "width": 640, "height": 360, "rate": 30.0}
        usual |= {"stall": 3.0}  # s; an emulated processor may be held up
        return V4l2Settings.model_validate({**usual, **changed})

    @contextmanager
    def camera(self, **changed: object) -> Iterator[V4l2Camera]:
        """A connected camera."""
        camera = V4l2Camera(self.settings(**changed), WallClock())
        try:
            camera.connect()
            yield camera
        finally:
            camera.close()

    @contextmanager
    def device(self) -> Iterator[Device]:
        """The device opened beside whoever streams."""
        device = Device.open(Kernel(), self.node())
        try:
            yield device
        finally:
            device.close()

    def set(self, **values: int) -> None:
        """Set controls; a button is pressed by any value."""
        with self.device() as device:
            known = controls_of(device)
            for name, value in values.items():
                control = Control(id=known[name].number, value=value)
                device.call(Ioctl.S_CTRL, control, f"setting {name}")

    @contextmanager
    def having(self, **values: int) -> Iterator[None]:
        """Controls at `values` meanwhile; they outlive every opening, so back in any
        case.
        """
        with self.device() as device:
            before = controls_of(device)
        self.set(**values)
        try:
            yield
        finally:
            self.set(**{name: before[name].default for name in values})

    def controls(self) -> dict[str, CameraControl]:
        """Controls by name."""
        with self.device() as device:
            return controls_of(device)

    def node(self, kind: str = "vid-cap") -> str:
        """vivid's node of its camera or another `kind`, whatever its number."""
        names = Path("/sys/class/video4linux").glob("video*/name")
        return next(
            f"/dev/{name.parent.name}" for name in names if kind in name.read_text()
        )

    def plug(self) -> None:
        """Make the link to the node."""
        self.unplug()
        self.link.symlink_to(self.node())

    def unplug(self) -> None:
        """Take the link away."""
        with suppress(FileNotFoundError):
            self.link.unlink()


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
