"""The real camera beside another arm: everything then runs in the time of the wall."""

from dataclasses import replace

from cell.config.cell import CellFile
from cell.devices.devices import Devices
from drivers.camera.camera import V4l2Camera
from drivers.camera.settings import V4l2Settings
from drivers.errors import ConfigurationError
from drivers.twin.clock import TwinClock
from drivers.twin.paced_clock import PacedClock


def camera_settings(settings: CellFile) -> V4l2Settings:
    """The cell file's camera; a cell file without one is a ConfigurationError."""
    if settings.camera is None:
        raise ConfigurationError(
            "cell.yaml: camera: is missing, camera v4l2 needs it; `cell camera` lists what is "
            "there and the section to add"
        )
    return settings.camera


def with_real_camera(devices: Devices, settings: CellFile) -> Devices:
    """`devices` with the cell file's camera, on a clock that keeps step with the wall.

    What it sees is not the twin's world, whose truth therefore scores nothing.
    """
    chosen = camera_settings(settings)
    clock = devices.clock
    if isinstance(clock, TwinClock):
        clock = PacedClock(clock)
    camera = V4l2Camera(chosen, clock)
    return replace(
        devices,
        clock=clock,
        camera=camera,
        camera_identity=chosen.identity,
        aids=None,
        plant=None,
        camera_locks=dict(chosen.controls),
    )
