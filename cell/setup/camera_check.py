"""Check whether a camera has moved since a view of it was pinned, or over a film."""

from collections.abc import Iterable, Iterator
from contextlib import closing
from dataclasses import dataclass
from itertools import islice
from math import inf, nan
from typing import Any

import cv2
import numpy as np

from calibration.calibration import Calibration
from calibration.view import GRID, ImageMotion, PinnedView
from cell.base.devices.devices import Devices
from cell.perception.region import still_surroundings
from cell.setup.wizard import live_images
from drivers.base.errors import ConfigurationError
from drivers.base.types import Frame, Image

ALLOWED = 0.5  # px, half of what must be told
SETTLED = 5  # images after which a camera's exposure has settled
FILM_PERIOD = 1.0  # s between the images of a film that are compared
ARROW = 0.06  # of the image's width, length of the longest arrow
ARROW_COLOUR = (0, 255, 255)  # BGR


@dataclass(frozen=True, slots=True)
class ViewCheck:
    """Comparison of a camera image, `frame`, with an earlier image, `pinned`, and the
    `motion` of the image between them.
    """

    pinned: Image
    frame: Frame
    motion: ImageMotion | None
    calibration: Calibration | None

    @property
    def pixels(self) -> float:
        """Largest shift between the two images [px]; NaN where the earlier view is not
        found again.
        """
        return nan if self.motion is None else self.motion.largest()

    @property
    def distance(self) -> float:
        """Largest shift between the two images in the plane of the strip [m]; NaN where
        it is not known.
        """
        if self.motion is None or self.calibration is None:
            return nan
        return self.motion.largest_in_plane(self.calibration)

    @property
    def passed(self) -> bool:
        """Whether the camera stands where it stood, because the images differ by no
        more than a small shift.
        """
        return self.pixels <= ALLOWED

    def sentence(self) -> str:
        """Sentence for the operator on whether the camera was moved, and by
        how much.
        """
        if self.motion is None:
            return (
                "the pinned view is not found again: the camera looks elsewhere, is"
                " covered, or sees too little that stands still"
            )
        verdict = "stands where it stood" if self.passed else "was moved"
        shift = f"{self.pixels:.1f} px"
        if self.calibration is not None:
            shift += f", {1e3 * self.distance:.2f} mm in the strip's plane"
        return f"the camera {verdict}: off by {shift}, allowed {ALLOWED} px"

    def facts(self) -> dict[str, Any]:
        """Plain values of the comparison in SI units, for JSON."""
        return {
            "passed": self.passed,
            "pixels": self.pixels,
            "distance": self.distance,
            "stamp": self.frame.stamp,
            "allowed_pixels": ALLOWED,
        }

    def picture(self) -> Image:
        """Picture of shape (height, width, 3) with the earlier view in red and the
        present one in cyan, grey where they agree, and arrows that show the motion
        enlarged.
        """
        before, now = (
            cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
            for image in (self.pinned, self.frame.image)
        )
        picture: Image = np.stack([now, now, before], axis=-1)
        if self.motion is not None:
            _draw_motion(picture, self.motion)
        return picture


def take_view(devices: Devices) -> Frame:
    """Image that the camera of `devices` takes once its exposure has settled; Fault
    where no image comes.
    """
    with closing(devices.camera):
        devices.camera.connect()
        return next(islice(live_images(devices), SETTLED, None))


def check_views(
    pinned: Image | None, frames: Iterable[Frame], calibration: Calibration | None
) -> ViewCheck:
    """Compare `frames` with the image `pinned`, of shape (height, width, 3), or with
    the first of them where that is None; returns the comparison with the largest shift.

    With the calibration of these images only what stands near the strip's plane counts.
    Raises ConfigurationError for images of another size, or none.
    """
    compared = list(_compare(pinned, frames, calibration))
    if not compared:
        raise ConfigurationError("the film holds no image to compare; name another")
    found = [check for check in compared if check.motion is not None]
    return max(found or compared, key=lambda check: check.pixels)


def every_second(frames: Iterable[Frame]) -> Iterator[Frame]:
    """Yield only some of a film's `frames`, about one in each second."""
    due = -inf
    for frame in frames:
        if frame.stamp >= due:
            due = frame.stamp + FILM_PERIOD
            yield frame


def _compare(
    pinned: Image | None, frames: Iterable[Frame], calibration: Calibration | None
) -> Iterator[ViewCheck]:
    view = None
    for frame in frames:
        if pinned is None:
            pinned = frame.image
        if pinned.shape != frame.image.shape:
            here, there = (
                f"{image.shape[1]} x {image.shape[0]}"
                for image in (frame.image, pinned)
            )
            raise ConfigurationError(
                f"the view is {here} px, the pinned one {there}; set the camera back,"
                " or pin its view with --pin"
            )
        if view is None:
            where = None if calibration is None else still_surroundings(calibration)
            view = PinnedView.choose(pinned, where)
        yield ViewCheck(
            pinned=pinned,
            frame=frame,
            motion=view.motion(frame.image),
            calibration=calibration,
        )


def _draw_motion(picture: Image, motion: ImageMotion) -> None:
    """Draw arrows into `picture` that show the `motion` of an image, where it was
    measured and on a grid all over.
    """
    size = motion.size
    points = np.concatenate([GRID * size, motion.positions])
    times = ARROW * size[0] / max(motion.largest(), ALLOWED)
    ends = points + times * motion.shift(points)
    for start, end in np.rint([points, ends]).astype(int).swapaxes(0, 1).tolist():
        cv2.arrowedLine(picture, start, end, ARROW_COLOUR, 2, cv2.LINE_AA)
    text = f"red: pinned, cyan: now; arrows {times:.0f} times as long as the shift"
    corner = (12, size[1] - 16)
    cv2.putText(picture, text, corner, cv2.FONT_HERSHEY_SIMPLEX, 0.7, ARROW_COLOUR, 2)
