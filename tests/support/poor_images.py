"""Images worse than the twin's: some of them lost, and what is read from them noisy."""

from contextlib import AbstractContextManager
from dataclasses import replace
from unittest.mock import patch

import numpy as np

from cell.config.cell import CellFile
from cell.devices.devices import Devices, DeviceSelection
from cell.devices.open import DeviceFactory, open_cell
from cell.orchestrator import phases
from cell.orchestrator.snapshot import Snapshot
from drivers.protocols import Camera
from drivers.strip.file import StripFile
from drivers.types import Frame
from policies.policy import Observation


class DroppingCamera:
    """A camera that loses a `share` of the frames of another."""

    def __init__(self, camera: Camera, share: float, seed: int) -> None:
        self._camera, self._share = camera, share
        self._rng = np.random.default_rng([seed, 1])
        self._lost = -np.inf

    @property
    def rate(self) -> float:
        return self._camera.rate

    def connect(self) -> None:
        self._camera.connect()

    def read(self, after: float, timeout: float) -> Frame | None:
        frame = self._camera.read(max(after, self._lost), timeout)
        if frame is None or self._rng.uniform() >= self._share:
            return frame
        self._lost = frame.stamp
        return None

    def close(self) -> None:
        self._camera.close()


def dropping(share: float, seed: int) -> DeviceFactory:
    """A cell as configured whose camera loses a `share` of its frames."""

    def opened(
        settings: CellFile, strip: StripFile, choice: DeviceSelection, *, calibrating: bool
    ) -> Devices:
        devices = open_cell(settings, strip, choice, calibrating=calibrating)
        if share == 0.0:
            return devices
        return replace(devices, camera=DroppingCamera(devices.camera, share, seed))

    return opened


def noisy(sigma: float, seed: int) -> AbstractContextManager[object]:
    """Policies are told observations with noise of `sigma` [m] on all that images show."""
    rng, plain, last = np.random.default_rng([seed, 2]), phases.observe, -np.inf
    noise = np.zeros(0)

    def observe(snapshot: Snapshot) -> Observation:
        nonlocal last, noise
        seen = plain(snapshot)
        if seen.stamp[0] != last:
            last, noise = float(seen.stamp[0]), sigma * rng.normal(size=3 + seen.profile.size)
        profile = seen.profile + noise[3:].reshape(seen.profile.shape)
        profile[:, -1] = seen.profile[:, -1]  # the gripper
        return replace(
            seen,
            contact_x=seen.contact_x + noise[0],
            tip_x=seen.tip_x + noise[1],
            tip_z=seen.tip_z + noise[2],
            profile=profile,
        )

    return patch.object(phases, "observe", observe)
