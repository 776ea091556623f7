"""A simulated camera on the wall clock, whose images are drawn between two ticks of the cell."""

from drivers.protocols import Camera
from drivers.types import Frame


class PacedCamera:
    """Satisfies `drivers.protocols.Camera` for a camera that draws its image while it is read.

    Drawing an image and reading the strip in it in one tick of the control loop would take twice as
    long as either. So the tick in which a frame arrives draws it, and the next one gets it; its
    stamp still says when the world was so.
    """

    def __init__(self, camera: Camera) -> None:
        """Deliver the frames of `camera`."""
        self._camera = camera
        self._drawn: Frame | None = None

    @property
    def rate(self) -> float:
        """Frames per second [Hz]."""
        return self._camera.rate

    def connect(self) -> None:
        """Start delivering frames."""
        self._camera.connect()

    def read(self, after: float, timeout: float) -> Frame | None:
        """The frame that the last call has drawn if its stamp is later than `after`, else None.

        Without such a frame, one that has arrived since is drawn for the next call.
        """
        drawn, self._drawn = self._drawn, None
        if drawn is not None and drawn.stamp > after:
            return drawn
        self._drawn = self._camera.read(after, timeout)
        return None

    def close(self) -> None:
        """Stop delivering frames."""
        self._drawn = None
        self._camera.close()
