"""A simulated camera on the wall clock, whose images are drawn between two ticks of the cell."""

from math import inf

from drivers.protocols import Camera
from drivers.types import Frame

SLOW_PERIOD = 0.1  # s between two images, from which on none is held back: no tick is full of them


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
