"""Real camera of a cell: opening it, proposing settings for cell.yaml, and taking a
test picture.
"""

from dataclasses import dataclass, replace

from cell.base.config.cell import CellFile
from cell.base.config.drivers import DRIVERS
from cell.base.devices.devices import Devices
from drivers.base.clock import WallClock
from drivers.base.errors import CellError, ConfigurationError
from drivers.base.plugins import guarded
from drivers.base.protocols import Clock, RealCamera
from drivers.base.settings import Settings, parse
from drivers.twin.clock import RealTimeClock, TwinClock
from drivers.v4l2.camera import CameraReport, V4l2Camera
from drivers.v4l2.formats import CameraMode
from drivers.v4l2.session import CameraFrame, Counts, Setup
from drivers.v4l2.settings import V4l2Settings

BEST_MODE = 1280, 720, 30.0  # px, px, Hz; larger modes are not proposed
RATE_MARGIN = 0.5  # Hz by which a camera's rate may miss a round number
# the less work the better
PREFERRED = ("YUYV", "GREY", "RGGB", "GRBG", "BA81", "GBRG", "MJPG")
WORTH_LOCKING = (  # controls that change what is measured
    "exposure_time_absolute",
    "gain",
    "white_balance_temperature",
    "focus_absolute",
    "zoom_absolute",
)
WATCHED = 1.0  # s of frames over which a test measures the rate
FIRST_FRAME_TIMEOUT = 5.0  # s that the first frame may take


def camera_settings(settings: CellFile) -> Settings:
    """Settings of the cell's real camera, as cell.yaml states them; raises
    ConfigurationError where they are missing or wrong.

    They are the section `camera` for V4L2, and `cameras: NAME` for the camera NAME of a
    plug-in.
    """
    driver = settings.camera_driver
    if driver != DRIVERS["cameras"]["v4l2"]:
        name = settings.drivers.camera
        with guarded("cameras", name):
            kind: type[Settings] = driver.load("settings")
        return parse(
            settings.cameras.get(name, {}), kind, f"cell.yaml: cameras: {name}"
        )
    if settings.camera is None:
        raise ConfigurationError(
            "cell.yaml: camera: is missing, camera v4l2 needs it; `cell camera` lists"
            " what is there and the section to add"
        )
    return settings.camera


def open_camera(settings: CellFile, clock: Clock) -> RealCamera:
    """Open the cell's real camera, whose frames are stamped by `clock`."""
    own = camera_settings(settings)
    with guarded("cameras", settings.drivers.camera):
        camera: RealCamera = settings.camera_driver.load()(own, clock)
    return camera


def with_real_camera(devices: Devices, settings: CellFile) -> Devices:
    """Copy of `devices` in which the camera is the cell's real one, on a clock that
    keeps real time.

    The camera does not see the twin's world, so the truth is not used for scoring.
    """
    clock = devices.clock
    if isinstance(clock, TwinClock):  # the camera's own thread runs by the wall clock
        clock = RealTimeClock(clock)
    camera = open_camera(settings, clock)
    return replace(
        devices,
        clock=clock,
        camera=camera,
        camera_identity=camera.identity,
        aids=None,
        plant=None,
        camera_locks=lambda: camera.locks,
        real_time=True,
    )


@dataclass(frozen=True, slots=True)
class Grab:
    """Test picture of a camera, with the camera's setup and statistics of the frames
    before it.

    `rate` [Hz] is measured by the stamps, `age` [s] from the middle of the exposure to
    arrival.
    """

    frame: CameraFrame
    setup: Setup
    counts: Counts
    rate: float
    age: float


def suggest_settings(camera: CameraReport) -> V4l2Settings | None:
    """Settings proposed for `camera`, with its controls locked as they are; None where
    no mode can be decoded.
    """
    modes = [
        mode for mode in camera.modes if mode.format in PREFERRED and not mode.steps
    ]
    if not modes:
        return None
    mode = max(modes, key=_suitability)
    rates = [rate for rate in mode.rates if rate <= BEST_MODE[2] + RATE_MARGIN] or list(
        mode.rates
    )
    values = {
        control.name: control.value
        for control in camera.controls
        if control.value is not None
    }
    locks = {name: value for name, value in values.items() if name in WORTH_LOCKING}
    return V4l2Settings(
        device=camera.device,
        format=mode.format,
        width=mode.width,
        height=mode.height,
        rate=max(rates, default=BEST_MODE[2]),
        controls=locks,
    )


def grab(settings: V4l2Settings) -> Grab:
    """Newest frame after watching a camera for WATCHED seconds, with statistics; raises
    CellError without frames.
    """
    camera = V4l2Camera(settings, WallClock())
    try:
        camera.connect()
        first = last = _next_frame(camera, after=-1.0)
        while last.stamp - first.stamp < WATCHED:
            last = _next_frame(camera, last.stamp)
        setup = camera.setup
        counts = camera.counts
    finally:
        camera.close()

    if setup is None:
        raise CellError(f"{settings.device}: was not set up")

    rate = (last.sequence - first.sequence) / (last.stamp - first.stamp)
    return Grab(
        frame=last, setup=setup, counts=counts, rate=rate, age=last.arrival - last.stamp
    )


def _next_frame(camera: V4l2Camera, after: float) -> CameraFrame:
    """Next frame of `camera` stamped later than `after` [s]; raises CellError where
    none comes.
    """
    frame = camera.read(after, FIRST_FRAME_TIMEOUT)
    if frame is None:
        raise CellError(f"no picture in {FIRST_FRAME_TIMEOUT:g} s")
    return frame


def _suitability(mode: CameraMode) -> tuple[bool, bool, int, int]:
    """Key that sorts camera modes, best last: fast ones, within BEST_MODE, near to it,
    and easy to decode.
    """
    width, height, rate = BEST_MODE
    fits = mode.width <= width and mode.height <= height
    fast = max(mode.rates, default=rate) >= rate - RATE_MARGIN
    area = mode.width * mode.height
    return fast, fits, area if fits else -area, -PREFERRED.index(mode.format)
