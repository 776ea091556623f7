"""Camera driver for V4L2 devices, and a report on the devices that are connected."""

import math
import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from drivers.base.errors import CellError, Fault
from drivers.base.protocols import Clock
from drivers.v4l2.controls import CameraControl, controls_of
from drivers.v4l2.device import CameraFaulty, CameraStalled, Device, Identity, Kernel
from drivers.v4l2.formats import CameraMode, PictureFormat, modes_of
from drivers.v4l2.session import (
    CameraFrame,
    Capture,
    CaptureSession,
    Counts,
    Sequence,
    Setup,
    StampSource,
)
from drivers.v4l2.settings import V4l2Settings

FRAME_TIMEOUT = 0.04  # s without a frame until the device's presence is checked
RETRY_INTERVAL = 0.1  # s between attempts to recover
FIRST_FRAME = 3.0  # s that a camera may take for its first frame
LEAST_STEP = 1e-6  # s by which stamps grow at least
SOURCE = "v4l2 camera"
DEVICE_LINKS_FOLDER = Path("/dev/v4l")


@dataclass(frozen=True, slots=True)
class StampedCapture:
    """One captured frame, not yet decoded, with its times `stamp` and `arrival` [s] on
    the cell's clock.
    """

    capture: Capture
    picture: PictureFormat
    sequence: int
    stamp: float
    arrival: float
    source: StampSource


class NewestFrame:
    """Thread that takes every frame of a camera, keeps the newest one, and recovers the
    device after a failure.

    A failure is raised by the next `newest`, at least once, and until a frame has
    arrived after it. A stalled or faulty stream is restarted; a lost device is reopened
    once its link exists again, and configured as before.
    """

    def __init__(
        self,
        kernel: Kernel,
        settings: V4l2Settings,
        clock: Clock,
        session: CaptureSession,
    ) -> None:
        self.counts = Counts()
        self._kernel = kernel
        self._settings = settings
        self._clock = clock
        self._changed = threading.Condition()
        self._closing = False
        self._newest: StampedCapture | None = None
        self._trouble: CellError | None = None
        self._recovered = False
        self._sequence = Sequence()
        self._patience = FIRST_FRAME
        self._last_complete = self._last_any = kernel.monotonic()
        self._current: CaptureSession | None = None
        self._thread = threading.Thread(
            target=self._run, args=(session,), name=SOURCE, daemon=True
        )
        self._thread.start()

    def newest(self, after: float, timeout: float) -> StampedCapture | None:
        """Newest frame with a stamp later than `after` [s]; None if none comes in
        `timeout` [s].

        Raises the device's error if it is failing or has failed since the last call.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._trouble or self._fresh(after), timeout)
            if self._trouble is None and not self._thread.is_alive():
                raise CameraFaulty(
                    self._settings.device, "the thread that reads it has ended"
                )
            if self._trouble is not None:
                trouble = self._trouble
                if self._recovered:
                    self._trouble = None
                raise trouble.with_traceback(None)
            return self._newest if self._fresh(after) else None

    def close(self) -> None:
        """Stop the thread that takes frames, which releases the camera."""
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        self._thread.join()

    def _fresh(self, after: float) -> bool:
        return self._newest is not None and self._newest.stamp > after

    def _run(self, session: CaptureSession) -> None:
        """Main function of the thread: serve the `session` and those that follow it,
        until the thread is closed.
        """
        self._current = session
        try:
            while not self._closing:
                self._serve_session()
        finally:
            self._release()

    def _serve_session(self) -> None:
        """Take frames until a failure, report the failure, and restart or release the
        session.
        """
        kernel = self._kernel
        try:
            if self._current is None:
                self._current = CaptureSession.open(kernel, self._settings)
                self._restart_counts()
            while not self._closing:
                capture = self._current.wait(FRAME_TIMEOUT)
                if capture is not None:
                    self._publish(self._current, capture)
                self._check_flow()
        except (CameraStalled, CameraFaulty) as error:
            self._report(error)
            kernel.sleep(RETRY_INTERVAL)
            self._restart()
        except CellError as error:
            self._report(error)
            self._release()
            kernel.sleep(RETRY_INTERVAL)

    def _check_flow(self) -> None:
        """Raise CameraStalled where no frame has come for too long, CameraFaulty where
        no complete one has.
        """
        time = self._kernel.monotonic()
        silent = time - self._last_any  # s
        corrupt = time - self._last_complete  # s
        if silent > self._patience:
            raise CameraStalled(self._settings.device, silent)
        if corrupt > self._patience:
            raise CameraFaulty(
                self._settings.device,
                f"every frame of the last {corrupt:.2f} s is corrupt",
            )

    def _publish(self, session: CaptureSession, capture: Capture) -> None:
        """Count a capture and publish it as the newest frame, unless it is corrupt."""
        counts = self.counts
        step = self._sequence.step_to(capture.counter)
        self._last_any = capture.taken
        counts.missing += max(step - 1, 0)
        counts.repeated += step < 1
        if capture.corrupt or not session.setup.picture.is_complete(capture.content):
            counts.corrupt += 1
            return

        self._last_complete = capture.taken
        self._patience = self._settings.stall
        arrived = self._on_cell_clock(session, capture)
        counts.arrived += 1
        counts.restamped += arrived.source is StampSource.DEQUEUE

        with self._changed:
            self._newest = arrived
            self._recovered = True
            self._changed.notify_all()

    def _on_cell_clock(
        self, session: CaptureSession, capture: Capture
    ) -> StampedCapture:
        """Frame `capture` with its stamp and arrival [s] on the cell's clock; stamps
        increase, and each is earlier than its arrival.
        """
        setup = session.setup
        last = self._newest
        earliest = -math.inf if last is None else last.stamp + LEAST_STEP
        monotonic = self._kernel.monotonic()
        arrival = self._clock.now()
        # of the kernel's clock, on which `capture` is stamped
        ahead = monotonic - arrival
        middle, source = setup.shutter.middle(
            capture.stamp, capture.flags, capture.taken
        )
        if middle - ahead < earliest:
            middle = capture.taken
            source = StampSource.DEQUEUE

        return StampedCapture(
            capture=capture,
            picture=setup.picture,
            sequence=self._sequence.number,
            stamp=max(min(middle - ahead, arrival - LEAST_STEP), earliest),
            arrival=arrival,
            source=source,
        )

    def _report(self, error: CellError) -> None:
        """Store `error`, which the next call of `newest` raises."""
        with self._changed:
            self._trouble = error
            self._recovered = False
            self._changed.notify_all()

    def _restart(self) -> None:
        """Restart the camera's stream, or release the device where that fails."""
        if self._current is None:
            return
        try:
            self._current.restart()
        except CellError as error:
            self._report(error)
            self._release()
        else:
            self._restart_counts()

    def _restart_counts(self) -> None:
        """Estimate how many frames were lost before a restart, and count on from the
        kernel's next number.
        """
        time = self._kernel.monotonic()
        missing = round((time - self._last_any) * self._settings.rate)
        self._sequence.restart(max(missing, 0))
        self._last_complete = self._last_any = time
        self._patience = FIRST_FRAME
        self.counts.restarts += 1

    def _release(self) -> None:
        session = self._current
        self._current = None
        if session is not None:
            session.close()


class V4l2Camera:
    """Camera driver for a V4L2 device, whose frames a thread takes and `read` decodes.

    Stamps are the middle of the exposure in the time of `clock`, which must run at
    wall-clock speed. `kernel` makes the system calls. `setup`, from `connect` on, is
    what the camera accepted.
    """

    def __init__(
        self, settings: V4l2Settings, clock: Clock, kernel: Kernel | None = None
    ) -> None:
        self.identity = settings.identity
        self._settings = settings
        self._clock = clock
        self._kernel = Kernel() if kernel is None else kernel
        self._frames: NewestFrame | None = None
        self.setup: Setup | None = None
        self._newest: CameraFrame | None = None

    @property
    def rate(self) -> float:
        """Frame rate [Hz] that the device accepted or, before `connect`, that is
        requested.
        """
        return self._settings.rate if self.setup is None else self.setup.picture.rate

    @property
    def locks(self) -> Mapping[str, int]:
        """Values to which the camera's controls are locked, by name: as read back or,
        before `connect`, as requested.
        """
        return self._settings.controls if self.setup is None else self.setup.locks

    @property
    def counts(self) -> Counts:
        """Counts of the camera's frames since `connect`: complete, missing, corrupt and
        others.
        """
        return Counts() if self._frames is None else self._frames.counts

    def connect(self) -> None:
        """Open the camera, set format and controls, and start its stream; allowed
        twice.

        Raises CameraLost, CameraBusy, CameraFaulty, or CameraRefused for a setting that
        the camera does not accept.
        """
        if self._frames is not None:
            return
        session = CaptureSession.open(self._kernel, self._settings)
        self.setup = session.setup
        self._newest = None
        self._frames = NewestFrame(
            kernel=self._kernel,
            settings=self._settings,
            clock=self._clock,
            session=session,
        )

    def read(self, after: float, timeout: float) -> CameraFrame | None:
        """Newest complete frame stamped later than `after` [s]; None if none in
        `timeout` [s].

        Raises CameraLost, CameraStalled, CameraBusy or CameraFaulty while the device is
        so, and once after it has recovered.
        """
        if self._frames is None:
            raise Fault(
                "camera_closed", "a frame was read before connect or after close"
            )
        arrived = self._frames.newest(after, timeout)
        if arrived is None:
            return None
        if self._newest is None or self._newest.sequence != arrived.sequence:
            self._newest = self._decode(arrived, self._frames.counts) or self._newest
        return self._newest if self._newest and self._newest.stamp > after else None

    def close(self) -> None:
        """Stop the stream and release the device; allowed twice."""
        if self._frames is not None:
            self._frames.close()
            self._frames = None

    def _decode(self, arrived: StampedCapture, counts: Counts) -> CameraFrame | None:
        """Decode the frame `arrived`; None, counted as corrupt, where its bytes are no
        picture.
        """
        image = arrived.picture.decode(arrived.capture.content)
        if image is None:
            counts.corrupt += 1
            return None
        image.setflags(write=False)
        return CameraFrame(
            stamp=arrived.stamp,
            arrival=arrived.arrival,
            source=SOURCE,
            sequence=arrived.sequence,
            image=image,
            stamp_source=arrived.source,
        )


@dataclass(frozen=True, slots=True)
class CameraReport:
    """Identity, modes and controls of the camera whose udev link is `device`."""

    device: str
    identity: Identity
    modes: tuple[CameraMode, ...]
    controls: tuple[CameraControl, ...]


@dataclass(frozen=True, slots=True)
class UnusableDevice:
    """Video device with a udev link that cannot be used as a camera, and the reason."""

    device: str
    problem: str


def list_cameras(
    kernel: Kernel, links: Path = DEVICE_LINKS_FOLDER
) -> Iterator[CameraReport | UnusableDevice]:
    """Yield a report on each video device with a udev link, or the reason why it is
    unusable.
    """
    for link in _device_links(links):
        try:
            yield report(kernel, link)
        except CellError as error:
            yield UnusableDevice(link, str(error))


def report(kernel: Kernel, link: str) -> CameraReport:
    """Identity, modes and controls of the camera at the udev link `link`; raises
    CellError where it cannot be opened.
    """
    device = Device.open(kernel, link)
    try:
        controls = tuple(controls_of(device).values())
        return CameraReport(
            device=link,
            identity=device.identify(),
            modes=tuple(modes_of(device)),
            controls=controls,
        )
    finally:
        device.close()


def _device_links(links: Path) -> list[str]:
    """Udev links in the folder `links`, one for each video device: by id, or where
    there is none by path.
    """
    links_by_device: dict[Path, str] = {}
    for kind in ("by-id", "by-path"):
        for link in sorted((links / kind).glob("*")):
            links_by_device.setdefault(link.resolve(), str(link))
    return sorted(links_by_device.values())
