"""The twin's camera: rendered frames of the simulated cell, on either clock."""

from collections.abc import Callable
from math import floor, inf

import numpy as np

from drivers.errors import Fault
from drivers.protocols import Camera, Clock
from drivers.strip.model import Observation
from drivers.twin.renderer.looks import PLAIN, Look, StripLook
from drivers.twin.renderer.optics import Optics
from drivers.twin.renderer.renderer import Renderer
from drivers.twin.scene import Scene
from drivers.twin.settings import CameraSettings
from drivers.types import Frame

SOURCE = "twin camera"
CLOCK_DIGITS = 9  # digits of a second that the clock knows
AS_CALIBRATED = Observation()
SLOW_PERIOD = 0.1  # s, image period above which drawing and reading fit into one tick


View = Callable[[float], Scene]
"""The scene of the cell that a camera sees at a time [s of the run]."""


class TwinCamera:
    """Simulated camera (`drivers.protocols.Camera`) that renders the scenes of its `view`.

    Frame k is exposed about k / rate, its stamp, and delivered `transport_delay` later; a share of
    them, `lost`, never is. Only frames that are read are rendered. `observation` holds what changed
    since the calibration and is hidden from the controller: the camera is moved, so that places
    appear scaled and shifted; lint or glare covers the point where the strip leaves the desk;
    frames show the world `camera_latency` [s] before their stamps, and a negative latency delays
    them. The desk stands `desk_height` [m] higher than at the calibration. Scenes are over the true
    desk. `surround` is the look of the cell about the strip.
    """

    def __init__(
        self,
        view: View,
        clock: Clock,
        settings: CameraSettings,
        look: StripLook,
        seed: int,
        observation: Observation = AS_CALIBRATED,
        desk_height: float = 0.0,
        surround: Look = PLAIN,
    ) -> None:
        self._view = view
        self._clock = clock
        self._settings = settings
        optics = displaced_optics(settings, observation, desk_height)
        bias = observation.contact_bias
        self._renderer = Renderer(settings, look, seed, optics, bias, surround)
        self._latency = observation.camera_latency
        self._seed = seed
        self._delay = settings.transport_delay + max(0.0, -self._latency)
        self._newest: Frame | None = None
        self._connected = False

    @property
    def rate(self) -> float:
        """Frames per second [Hz]."""
        return self._settings.rate

    def connect(self) -> None:
        """Start delivering frames."""
        self._connected = True

    def read(self, after: float, timeout: float) -> Frame | None:  # noqa: ARG002
        """The newest frame that has arrived with a stamp later than `after`, or None.

        Never waits, whatever `timeout` is: the caller waits on the clock. Raises Fault when the
        camera is not connected.
        """
        if not self._connected:
            raise Fault("camera_closed", "a frame was read before connect or after close")
        sequence = self._last_arrived()
        if sequence < 0 or self._stamp(sequence) <= after:
            return None
        if self._newest is None or self._newest.sequence != sequence:
            self._newest = self._frame(sequence)
        return self._newest

    def close(self) -> None:
        """Stop delivering frames."""
        self._connected = False
        self._newest = None

    def _last_arrived(self) -> int:
        """Sequence of the newest frame that has arrived; -1 before the first."""
        now = self._clock.now()
        sequence = floor((now - self._delay) * self._settings.rate) + 1
        while sequence >= 0 and (self._arrival(sequence) > now or self._is_lost(sequence)):
            sequence -= 1
        return max(sequence, -1)

    def _is_lost(self, sequence: int) -> bool:
        share = self._settings.lost
        return share > 0 and np.random.default_rng([self._seed, sequence]).uniform() < share

    def _stamp(self, sequence: int) -> float:
        return round(sequence / self._settings.rate, CLOCK_DIGITS)

    def _arrival(self, sequence: int) -> float:
        return round(self._stamp(sequence) + self._delay, CLOCK_DIGITS)

    def _frame(self, sequence: int) -> Frame:
        stamp = self._stamp(sequence)
        image = self._renderer.render(self._exposure(stamp - self._latency), sequence)
        image.setflags(write=False)
        return Frame(stamp, self._arrival(sequence), SOURCE, sequence, image)

    def _exposure(self, middle: float) -> list[Scene]:
        """Scenes at the middles of equal parts of the exposure around `middle` [s], from 0 s on."""
        count = self._settings.sub_shapes
        offsets = (np.arange(count) + 0.5) / count - 0.5
        moments = middle + offsets * self._settings.exposure
        return [self._view(max(float(moment), 0.0)) for moment in moments]


def displaced_optics(
    settings: CameraSettings, observation: Observation, desk_height: float
) -> Optics:
    """Camera model of `settings`, displaced by the calibration errors in `observation`.

    A point p (2,) x, z [m] of the strip's plane is seen at (1 + scale) (p + (0, desk_height)) +
    shift.
    """
    shift = observation.shift_x, observation.shift_z
    moved = Optics.of(settings).displace(observation.scale, shift)
    return moved.displace(0.0, (0.0, desk_height))


class PacedCamera:
    """Camera wrapper that draws an image in one control tick and delivers it in the next.

    It satisfies `drivers.protocols.Camera`. Drawing an image and reading the strip in it in one
    tick of the control loop would take twice as long as either. So the tick in which a frame
    arrives draws it, and the next one gets it; its stamp still says when the world was so.
    """

    def __init__(self, camera: Camera) -> None:
        """Deliver the frames of `camera`."""
        self._camera = camera
        self._drawn: Frame | None = None
        self._last = -inf

    @property
    def rate(self) -> float:
        """Frames per second [Hz]."""
        return self._camera.rate

    def connect(self) -> None:
        """Start delivering frames."""
        self._camera.connect()

    def read(self, after: float, timeout: float) -> Frame | None:
        """The frame that the last call has drawn if its stamp is later than `after`, else None.

        Without such a frame, one that has arrived since is drawn for the next call; a caller that
        comes late or seldom gets it at once.
        """
        drawn, self._drawn = self._drawn, None
        if drawn is not None and drawn.stamp > after:
            return self._deliver(drawn)
        newest = self._camera.read(after, timeout)
        if newest is not None and newest.stamp - self._last > SLOW_PERIOD:
            return self._deliver(newest)
        self._drawn = newest
        return None

    def close(self) -> None:
        """Stop delivering frames."""
        self._drawn = None
        self._camera.close()

    def _deliver(self, frame: Frame) -> Frame:
        self._last = frame.stamp
        return frame
