"""Is this image news? Its age, and whether the camera keeps repeating itself."""

from dataclasses import dataclass

import numpy as np

from drivers.types import Frame


@dataclass(frozen=True, slots=True)
class ImageHealth:
    """Age [s] of the newest image, and how many images in a row equal it byte for byte."""

    age: float
    identical: int


class ImageSanity:
    """Told every frame; remembers one. A live camera's noise never repeats an image."""

    def __init__(self) -> None:
        self._last: Frame | None = None
        self._identical = 0

    def tell(self, frame: Frame, now: float) -> ImageHealth:
        """Health after `frame`, looked at when the clock says `now` [s]; 1 is a fresh image."""
        last = self._last
        if last is not None and last.sequence == frame.sequence:
            return ImageHealth(now - frame.stamp, self._identical)
        same = last is not None and np.array_equal(last.image, frame.image)
        self._identical = self._identical + 1 if same else 1
        self._last = frame
        return ImageHealth(now - frame.stamp, self._identical)
