"""Stand-ins for the measuring process that reads images beside the control loop."""

import time

import numpy as np

from cell.perception.image_reader import ImageResult
from cell.perception.preflight import PreflightCheck
from cell.perception.strip_measurement import SeenTouch, StripMeasurement

HANGS, FAILS = 250, 251


class PlainSight:
    """Measures nothing: the first pixel becomes the confidence; 250 hangs, 251
    fails.
    """

    def __init__(self, subject) -> None:
        self.subject = subject

    def inspect(self, frame) -> tuple[PreflightCheck, ...]:
        return (
            PreflightCheck("bright", bool(frame.image[0, 0, 0] > 9), "it is", "a lamp"),
        )

    def measure(self, frame, gripper, *, touches: bool, hand=None) -> ImageResult:
        value = int(frame.image[0, 0, 0])
        if value == HANGS:
            time.sleep(60.0)
        if value == FAILS:
            raise ZeroDivisionError("nobody foresaw this")
        points = np.column_stack([np.arange(value) / 10, np.arange(value) / 20])
        seen = StripMeasurement(
            frame.stamp,
            frame.sequence,
            0.3,
            value / 100,
            points,
            0.9,
            (0.5, 0.1),
            np.nan,
            np.nan,
            (gripper.x, gripper.z),
        )
        touch = SeenTouch(frame.stamp, 0.2, 0.3, 0.31, confidence=0.8, distance=0.001)
        return ImageResult(seen, touch if touches else None)
