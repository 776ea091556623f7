"""Combination of the real camera with any arm, both on the wall clock."""

from dataclasses import replace

from cell.config.cell import CellFile
from cell.devices.devices import Devices
from drivers.camera.camera import V4l2Camera
from drivers.camera.settings import V4l2Settings
from drivers.errors import ConfigurationError
from drivers.protocols import Clock
from drivers.twin.clock import RealTimeClock, TwinClock


def camera_settings(settings: CellFile) -> V4l2Settings:
    """Camera settings of the cell file; ConfigurationError where it has none."""
    if settings.camera is None:
        raise ConfigurationError(
            "cell.yaml: camera: is missing, camera v4l2 needs it; `cell camera` lists what is "
            "there and the section to add"
        )
    return settings.camera


def with_real_camera(devices: Devices, settings: CellFile) -> Devices:
    """Replace the camera of `devices` by the cell file's, on a clock in step with the wall clock.

    The camera does not see the twin's world, so the truth is not used for scoring.
    """
    chosen, clock = camera_settings(settings), _real_time_clock(devices.clock)
    camera = V4l2Camera(chosen, clock)
    return replace(
        devices,
        clock=clock,
        camera=camera,
        camera_identity=chosen.identity,
        aids=None,
        plant=None,
        camera_locks=lambda: chosen.controls if camera.setup is None else camera.setup.locks,
        real_time=True,
    )


def _real_time_clock(clock: Clock) -> Clock:
    """Clock that keeps step with the wall clock, as the camera's own thread needs it."""
    return RealTimeClock(clock) if isinstance(clock, TwinClock) else clock
