"""The kernel's virtual camera, with the faults that it can play."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from drivers.camera.abi import Control, Request
from drivers.camera.camera import V4l2Camera
from drivers.camera.controls import CameraControl, controls_of
from drivers.camera.device import Device
from drivers.camera.kernel import Kernel, Linux
from drivers.camera.settings import V4l2Settings
from drivers.clock import WallClock

END, START = 0, 1  # vivid's menu of timestamp sources
LINKS = Path("/dev/v4l/by-id")
DRIVER = Path("/sys/bus/platform/drivers/vivid")


class Vivid:
    """vivid behind a link of its own, as udev would make one. Controls return to their defaults."""

    def __init__(self) -> None:
        self.link = LINKS / "usb-vivid-test-camera"
        LINKS.mkdir(parents=True, exist_ok=True)
        self.plug()

    def settings(self, **changed: object) -> V4l2Settings:
        """640x360 YUYV at 30 Hz unless `changed`."""
        usual = {"device": str(self.link), "width": 640, "height": 360, "rate": 30.0}
        usual["stall"] = 3.0  # s; an emulated processor may be held up
        return V4l2Settings.model_validate({**usual, **changed})

    @contextmanager
    def camera(self, kernel: Kernel | None = None, **changed: object) -> Iterator[V4l2Camera]:
        """A connected camera."""
        camera = V4l2Camera(self.settings(**changed), WallClock(), kernel)
        try:
            camera.connect()
            yield camera
        finally:
            camera.close()

    @contextmanager
    def device(self) -> Iterator[Device]:
        """The device opened beside whoever streams."""
        device = Device.open(Linux(), self.node())
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
                device.call(Request.S_CTRL, control, f"setting {name}")

    @contextmanager
    def having(self, **values: int) -> Iterator[None]:
        """Controls at `values` meanwhile; they outlive every opening, so back in any case."""
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

    def node(self) -> str:
        """vivid's node, whatever its number."""
        names = Path("/sys/class/video4linux").glob("video*/name")
        return next(f"/dev/{name.parent.name}" for name in names if "vivid" in name.read_text())

    def plug(self) -> None:
        """Make the link to the node."""
        self.unplug()
        self.link.symlink_to(self.node())

    def unplug(self) -> None:
        """Take the link away."""
        with suppress(FileNotFoundError):
            self.link.unlink()


class Counting(Linux):
    """The kernel, with its waits counted."""

    def __init__(self) -> None:
        self.waits = 0

    def wait(self, fd: int | None, seconds: float) -> int:
        """As the kernel does."""
        self.waits += 1
        return super().wait(fd, seconds)
