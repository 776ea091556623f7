"""The V4L2 camera as a `drivers.protocols.Camera`."""

from drivers.camera.drain import Arrived, Drain
from drivers.camera.frame import CameraFrame, Counts
from drivers.camera.kernel import Kernel, Linux
from drivers.camera.session import Session, Setup
from drivers.camera.settings import V4l2Settings
from drivers.errors import Fault
from drivers.protocols import Clock

SOURCE = "v4l2 camera"


class V4l2Camera:
    """V4L2 camera with the interface `drivers.protocols.Camera`.

    A thread keeps the newest frame; `read` decodes the frames that are used. Stamps are the middle
    of the exposure in the time of `clock`, which must run at wall-clock speed. `kernel` makes the
    system calls and can be replaced in tests.
    """

    def __init__(self, settings: V4l2Settings, clock: Clock, kernel: Kernel | None = None) -> None:
        self._settings = settings
        self._clock = clock
        self._kernel = Linux() if kernel is None else kernel
        self._drain: Drain | None = None
        self._setup: Setup | None = None
        self._newest: CameraFrame | None = None

    @property
    def rate(self) -> float:
        """Frames per second [Hz]: measured after `connect`, requested before it."""
        return self._settings.rate if self._setup is None else self._setup.picture.rate

    @property
    def setup(self) -> Setup | None:
        """Settings as the camera accepted them; None before the first `connect`."""
        return self._setup

    @property
    def counts(self) -> Counts:
        """Counts of frames since `connect`, by what happened to them."""
        return Counts() if self._drain is None else self._drain.counts

    def connect(self) -> None:
        """Open, configure, lock the controls and start; does nothing when already connected.

        Raises CameraLost, CameraBusy, CameraFaulty, or CameraRefused for a setting that the camera
        does not accept.
        """
        if self._drain is not None:
            return
        session = Session.open(self._kernel, self._settings)
        self._setup = session.setup
        self._newest = None
        self._drain = Drain(self._kernel, self._settings, self._clock, session)

    def read(self, after: float, timeout: float) -> CameraFrame | None:
        """The newest whole frame that has arrived with a stamp later than `after`, or None.

        Waits at most `timeout` [s]; 0 only looks. Raises CameraLost, CameraStalled, CameraBusy or
        CameraFaulty while the device is so, and once after it recovered by itself.
        """
        if self._drain is None:
            raise Fault("camera_closed", "a frame was read before connect or after close")
        arrived = self._drain.newest(after, timeout)
        if arrived is None:
            return None
        if self._newest is None or self._newest.sequence != arrived.sequence:
            self._newest = self._decode(arrived, self._drain.counts) or self._newest
        return self._newest if self._newest and self._newest.stamp > after else None

    def close(self) -> None:
        """Stop and release the device; calling it twice is allowed."""
        if self._drain is not None:
            self._drain.close()
            self._drain = None

    def _decode(self, arrived: Arrived, counts: Counts) -> CameraFrame | None:
        """The decoded frame, or None where its bytes are not a picture."""
        image = arrived.picture.decode(arrived.capture.content)
        if image is None:
            counts.corrupt += 1
            return None
        image.setflags(write=False)
        return CameraFrame(
            arrived.stamp,
            arrived.arrival,
            SOURCE,
            arrived.sequence,
            image,
            arrived.gap,
            arrived.source,
            arrived.capture.flags,
        )
