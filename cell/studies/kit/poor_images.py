"""A camera that loses some of its images."""

from dataclasses import replace

import numpy as np

from cell.config.cell import CellFile
from cell.devices.devices import Devices, DeviceSelection
from cell.devices.open import DeviceFactory, open_cell
from drivers.protocols import Camera
from drivers.strip.file import StripFile
from drivers.types import Frame


class DroppingCamera:
    """A camera that loses a `share` of the frames of another."""

    def __init__(self, camera: Camera, share: float, seed: int) -> None:
        self._camera, self._share = camera, share
        self._rng = np.random.default_rng([seed, 1])
        self._lost = -np.inf

    @property
    def rate(self) -> float:
        """Frames a second of the camera, lost ones included."""
        return self._camera.rate

    def connect(self) -> None:
        """Connect the camera."""
        self._camera.connect()

    def read(self, after: float, timeout: float) -> Frame | None:
        """The next frame; None where it is lost."""
        frame = self._camera.read(max(after, self._lost), timeout)
        if frame is None or self._rng.uniform() >= self._share:
            return frame
        self._lost = frame.stamp
        return None

    def close(self) -> None:
        """Close the camera."""
        self._camera.close()


def dropping(share: float, seed: int) -> DeviceFactory:
    """Device factory of a configured cell whose camera loses a `share` of its frames."""

    def open_poor_cell(
        settings: CellFile, strip: StripFile, choice: DeviceSelection, *, calibrating: bool
    ) -> Devices:
        devices = open_cell(settings, strip, choice, calibrating=calibrating)
        if share == 0.0:
            return devices
        return replace(devices, camera=DroppingCamera(devices.camera, share, seed))

    return open_poor_cell
