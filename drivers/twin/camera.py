"""Simulated camera, which renders frames of the simulated cell."""

from collections.abc import Callable
from math import floor, inf

import numpy as np

from drivers.base.errors import Fault
from drivers.base.protocols import Camera, Clock
from drivers.base.types import Frame
from drivers.strip.model import ObservationModel
from drivers.twin.renderer.optics import Optics
from drivers.twin.renderer.renderer import Renderer
from drivers.twin.settings import CameraSettings
from drivers.twin.world import WorldState

SOURCE = "twin camera"
CLOCK_DIGITS = 9  # digits of a second that the clock knows
SLOW_PERIOD = 0.1  # s, image period above which drawing and reading fit into one tick


ScenesOverTime = Callable[[float], WorldState]
"""Function from a time [s of the run] to the scene of the cell that a camera sees then.
"""


class TwinCamera:
    """Simulated camera, which renders the scenes that its `view` gives for
    each time.

    Frame k is exposed about k / rate, its stamp, and delivered `transport_delay` later,
    but for a share `lost` of the frames, chosen by `seed`. Only frames that are read
    are rendered. They show the world `latency` [s] before their stamps, and a negative
    latency delays them.
    """

    def __init__(
        self,
        view: ScenesOverTime,
        clock: Clock,
        settings: CameraSettings,
        renderer: Renderer,
        seed: int,
        latency: float = 0.0,
    ) -> None:
        """Camera of `settings` whose images `renderer` draws of the scenes of
        `view`.
        """
        self._view = view
        self._clock = clock
        self._settings = settings
        self._renderer = renderer
        self._latency = latency
        self._seed = seed
        self._delay = settings.transport_delay + max(0.0, -self._latency)
        self._newest: Frame | None = None
        self._connected = False

    @property
    def rate(self) -> float:
        """Frame rate [Hz] of the camera."""
        return self._settings.rate

    def connect(self) -> None:
        """Start to deliver frames of the simulated camera."""
        self._connected = True

    def read(self, after: float, timeout: float) -> Frame | None:  # noqa: ARG002
        """Newest frame that has arrived with a stamp later than `after` [s]; None for
        none.

        Never waits, whatever `timeout` is: the caller waits on the clock. Raises Fault
        where the camera is not connected.
        """
        if not self._connected:
            raise Fault(
                "camera_closed", "a frame was read before connect or after close"
            )
        sequence = self._last_arrived()
        if sequence < 0 or self._stamp(sequence) <= after:
            return None
        if self._newest is None or self._newest.sequence != sequence:
            self._newest = self._frame(sequence)
        return self._newest

    def close(self) -> None:
        """Stop the delivery of frames by the simulated camera."""
        self._connected = False
        self._newest = None

    def _last_arrived(self) -> int:
        """Sequence number of the newest frame that has arrived; -1 before the first."""
        now = self._clock.now()
        sequence = floor((now - self._delay) * self._settings.rate) + 1
        while sequence >= 0 and (
            self._arrival(sequence) > now or self._is_lost(sequence)
        ):
            sequence -= 1
        return max(sequence, -1)

    def _is_lost(self, sequence: int) -> bool:
        share = self._settings.lost
        return (
            share > 0
            and np.random.default_rng([self._seed, sequence]).uniform() < share
        )

    def _stamp(self, sequence: int) -> float:
        return round(sequence / self._settings.rate, CLOCK_DIGITS)

    def _arrival(self, sequence: int) -> float:
        return round(self._stamp(sequence) + self._delay, CLOCK_DIGITS)

    def _frame(self, sequence: int) -> Frame:
        """Render frame number `sequence`, which can no longer change."""
        stamp = self._stamp(sequence)
        image = self._renderer.render(self._exposure(stamp - self._latency), sequence)
        image.setflags(write=False)
        return Frame(
            stamp=stamp,
            arrival=self._arrival(sequence),
            source=SOURCE,
            sequence=sequence,
            image=image,
        )

    def _exposure(self, middle: float) -> list[WorldState]:
        """Scenes at several times during the exposure whose middle is at `middle` [s];
        none before 0 s.
        """
        sub_shapes = self._settings.sub_shapes
        offsets = (np.arange(sub_shapes) + 0.5) / sub_shapes - 0.5
        moments = middle + offsets * self._settings.exposure
        return [self._view(max(float(moment), 0.0)) for moment in moments]


def displaced_optics(
    settings: CameraSettings, observation: ObservationModel, desk_height: float
) -> Optics:
    """Camera model of `settings`, displaced by the calibration errors in `observation`.

    These are hidden from the controller, as is a desk that is `desk_height` [m] higher
    than at the calibration. A point p (2,) x, z [m] of the strip's plane appears where
    (1 + scale) (p + (0, desk_height)) + shift would appear without.
    """
    shift = (observation.shift_x, observation.shift_z)
    optics = Optics.from_settings(settings).displace(observation.scale, shift)
    return optics.displace(0.0, (0.0, desk_height))


class PacedCamera:
    """Wrapper of a simulated camera that renders a frame in one call of `read`, and
    delivers it in the next.

    To render a frame and to measure the strip in it within one tick of the control loop
    would take twice as long as either. The stamp still is the time of the exposure.
    """

    def __init__(self, camera: Camera) -> None:
        """Wrap the simulated `camera`, whose frames are delivered one call after they
        are rendered.
        """
        self._camera = camera
        self._drawn: Frame | None = None
        self._last = -inf

    @property
    def rate(self) -> float:
        """Frame rate [Hz] of the camera."""
        return self._camera.rate

    def connect(self) -> None:
        """Start to deliver frames of the wrapped camera."""
        self._camera.connect()

    def read(self, after: float, timeout: float) -> Frame | None:
        """Frame with a stamp later than `after` [s]; None where none has come, or the
        newest has only been rendered.

        To render takes longer than a turn of the control loop may wait: a frame that
        has arrived is rendered in this call and delivered by the next one. A caller
        that comes seldom (SLOW_PERIOD) gets it at once.
        """
        drawn = self._drawn
        self._drawn = None
        if drawn is not None and drawn.stamp > after:
            return self._deliver(drawn)
        newest = self._camera.read(after, timeout)
        if newest is not None and newest.stamp - self._last > SLOW_PERIOD:
            return self._deliver(newest)
        self._drawn = newest
        return None

    def close(self) -> None:
        """Stop the delivery of frames by the wrapped camera."""
        self._drawn = None
        self._camera.close()

    def _deliver(self, frame: Frame) -> Frame:
        self._last = frame.stamp
        return frame
