"""A camera that is open, configured from the cell file, and streaming."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

from drivers.camera.controls import EXPOSURE, EXPOSURE_UNIT, controls_of, lock
from drivers.camera.device import Device, Identity
from drivers.camera.errors import CameraFaulty, CameraLost
from drivers.camera.formats import Picture, agree
from drivers.camera.kernel import Kernel
from drivers.camera.settings import V4l2Settings
from drivers.camera.stamps import Shutter
from drivers.camera.stream import Capture, Stream


@dataclass(frozen=True, slots=True)
class Setup:
    """Settings as the camera accepted them, including the values that a calibration depends on."""

    identity: Identity
    picture: Picture
    locks: Mapping[str, int]
    shutter: Shutter


@dataclass(slots=True)
class Session:
    """An open device with the setup that it accepted and its running stream."""

    device: Device
    settings: V4l2Settings
    setup: Setup
    stream: Stream

    @classmethod
    def open(cls, kernel: Kernel, settings: V4l2Settings) -> Self:
        """Open and configure the device, and start its stream.

        Raises CameraLost, CameraBusy, CameraFaulty or CameraRefused.
        """
        device = Device.open(kernel, settings.device)
        try:
            setup = set_up(device, settings)
            return cls(device, settings, setup, Stream.start(device, settings.buffers))
        except BaseException:
            device.close()
            raise

    def wait(self, seconds: float) -> Capture | None:
        """The next frame, or None when there is none for `seconds`.

        Raises CameraLost, or CameraFaulty where poll wakes up without a frame: polling again at
        once would be a busy loop.
        """
        events = self.device.kernel.wait(self.device.fd, seconds)
        if not events:
            if not self.device.present():
                raise CameraLost(self.device.path, "no longer answers")
            return None
        capture = self.stream.take()
        if capture is None:
            if not self.device.present():
                raise CameraLost(self.device.path, "is gone, says poll")
            raise CameraFaulty(self.device.path, "poll reports an error and no frame")
        return capture

    def restart(self) -> None:
        """Stop and start the stream; the device stays open and keeps its setup."""
        self.stream.stop()
        self.stream = Stream.start(self.device, self.settings.buffers)

    def close(self) -> None:
        """Stop the stream, and release its buffers and the device."""
        self.stream.stop()
        self.device.close()


def set_up(device: Device, settings: V4l2Settings) -> Setup:
    """Configure format and controls of `device`; raises CameraRefused where it refuses one."""
    picture = agree(device, settings)
    locks = lock(device, settings.controls)
    exposure = settings.exposure
    control = controls_of(device).get(EXPOSURE)
    if control is not None and control.value is not None:
        exposure = control.value * EXPOSURE_UNIT
    shutter = Shutter(1.0 / picture.rate, exposure, settings.readout)
    return Setup(device.identity, picture, locks, shutter)
