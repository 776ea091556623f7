"""Tracking of a strip's held end in images alone, where no arm reports its pose."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from calibration.calibration import Calibration
from cell.perception.measurement import StripMeasurement
from cell.perception.perception import Perception
from cell.perception.scene import Appearance
from cell.perception.settings import PerceptionSettings
from drivers.geometry import arc_lengths
from drivers.strip.file import StripFile
from drivers.types import Array, Frame, Pose

PROFILE_CONFIDENCE = 0.5  # confidence in a profile from which the end is taken from it
CLOSE = 0.001  # m by which the end may still move when it counts as found
ROUNDS = 6
TANGENT_LENGTH = 0.02  # m at the profile's end that give its tangent
MOST_STEPS = 5.0  # times the last motion of the end, by which it is extrapolated
UPRIGHT_HEIGHT = 0.1  # m of lift after which the end hangs upright
LIFTS = (0.03, 0.045, 0.06, 0.08)  # m of height at which an end that was just lifted is looked for
SEARCH_STEPS = (-0.03, -0.015, 0.015, 0.03)  # m about where it should be, when it is not there


@dataclass(frozen=True, slots=True)
class HeldMeasurement:
    """Measurement of one image, and the pose of the held `end`, None where it was not found."""

    measurement: StripMeasurement
    end: Pose | None


class HeldEnd:
    """Tracks the held end of a strip from image to image.

    Of a strip of known length, what is missing between the seen profile and the whole length lies
    in the grip: the end is the point at that length along the profile. It moves where the profile
    is read, so both are found together, in a few rounds from where the end should be by now.
    """

    def __init__(
        self,
        calibration: Calibration,
        settings: PerceptionSettings,
        strip: StripFile,
        appearance: Appearance,
    ) -> None:
        self._perception = Perception(calibration, settings, strip, appearance)
        self._length = strip.length
        self._past: list[tuple[float, Pose]] = []

    def look(self, frame: Frame) -> HeldMeasurement:
        """Measure the strip and its held end in `frame`; frames must come in their order."""
        first, *others = self._guesses(frame.stamp)
        best = self._settle(frame, first)
        for guess in others:
            if best.end is not None and best.measurement.confidence >= PROFILE_CONFIDENCE:
                break
            found = self._settle(frame, guess)
            if found.measurement.confidence > best.measurement.confidence:
                best = found
        if best.end is not None:
            self._past = [*self._past[-2:], (frame.stamp, best.end)]
        return best

    def _guesses(self, stamp: float) -> Iterator[Pose]:
        """Guesses of the held end's pose: extrapolated, last, and nearby; at first, just lifted."""
        if not self._past:
            yield Pose(self._length, 0.0, 0.0)
            for height in LIFTS:
                pitch = min(height / UPRIGHT_HEIGHT, 1.0) * np.pi / 2
                yield Pose(self._length - height / 2, height, pitch)
            return
        last = self._past[-1][1]
        expected = self._predict(stamp)
        yield expected
        yield last
        for step in SEARCH_STEPS:
            yield replace(expected, x=expected.x + step)
            yield replace(expected, z=max(expected.z + step, 0.0))

    def _predict(self, stamp: float) -> Pose:
        if len(self._past) < 2:
            return self._past[-1][1]
        (before, start), (then, last) = self._past[-2:]
        steps = min((stamp - then) / (then - before), MOST_STEPS)
        ahead = last.as_array() + steps * (last.as_array() - start.as_array())
        return Pose(float(ahead[0]), max(float(ahead[1]), 0.0), last.pitch)

    def _settle(self, frame: Frame, guess: Pose) -> HeldMeasurement:
        """Measure strip and end by fixed-point iteration from `guess`; end None if it diverges."""
        for _ in range(ROUNDS):
            measurement = self._perception.look(frame, guess)
            end = self._end(measurement)
            if end is None:
                return HeldMeasurement(measurement, None)
            moved = float(np.hypot(end.x - guess.x, end.z - guess.z))
            guess = end
            if moved < CLOSE:
                return HeldMeasurement(replace(measurement, gripper=(end.x, end.z)), end)
        return HeldMeasurement(measurement, None)

    def _end(self, measurement: StripMeasurement) -> Pose | None:
        """Pose at the strip's full length along the extrapolated profile; None without profile."""
        curve = measurement.profile
        if len(curve) < 2:
            return None
        along = measurement.contact_x + arc_lengths(curve)
        within = curve[along <= self._length]
        if len(within) < 2:
            return None
        return _extrapolate(within, self._length - float(along[len(within) - 1]))


def _extrapolate(curve: Array, distance: float) -> Pose:
    """Pose at `distance` [m] beyond the end of a curve (n, 2) [m], along its last stretch."""
    back = np.hypot(*(curve - curve[-1]).T)
    begin = int(np.flatnonzero(back >= min(TANGENT_LENGTH, float(back.max())))[-1])
    way = curve[-1] - curve[begin]
    way = way / max(float(np.hypot(*way)), 1e-9)
    point = curve[-1] + distance * way
    return Pose(float(point[0]), float(point[1]), float(np.arctan2(way[1], way[0])))
