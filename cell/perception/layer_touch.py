"""Detection of the layers' touch in an image sequence: the gap closes, the fold stops
falling.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp, nan

import numpy as np

from cell.perception.perception import LENGTH_ERROR
from cell.perception.strip_measurement import SeenTouch, StripMeasurement
from drivers.base.geometry import lengths, running_sums
from drivers.base.types import Array, Pose
from drivers.strip.file import StripFile

MARGIN = 0.0006  # m over the touching distance: noise
STOP_SHARE = 0.3  # of the closing speed: slower has stopped
AGREEMENT = 0.05  # s by which the two signals may differ
FALLS_KEPT = 40  # measurements that are remembered
# times AGREEMENT, from where on the two signals show different events
LARGEST_RATIO = 4.0
THINNEST = 0.001  # m, distance at which layers of a thin strip count as touching
FEWEST_FALLS = 6  # measurements of the fall, before which nothing is decided
RECENT_FALLS = 3  # last measurements that must show closed layers
# of the fall between two images, by which a gap is still above that at rest
RISE_SHARE = 0.25
RESTING_FALLS = 20  # in a row at one distance, of layers that rest
# of the folded length that the layers may differ by, where anyone speaks of a fold
UNEVEN = 0.5


@dataclass(frozen=True, slots=True)
class Fall:
    """Falling fold in one image at `time` [s]: the `gap` [m] between its layers, and
    the position `x` [m] of that gap.

    `to_grasped` [m] is the arc length from there along the upper layer to the gripper
    point.
    """

    time: float
    gap: float
    x: float
    to_grasped: float


class LayerTouch:
    """Detects the touch of the layers in a sequence of measurements, where two signals
    agree.

    The first signal is the gap: within MARGIN of the touching distance. The second is
    the fall: its speed drops to STOP_SHARE of what it was while the gap closed. The
    time of the touch is where the closing gap, extrapolated from before the stop,
    reaches the touching distance. That is the strip's thickness; where the file states
    a spread of it, the gap that stays.
    """

    def __init__(self, strip: StripFile, goal: float = 0.0) -> None:
        """Detect the touch of a fold whose grasped edge is to lie at x = `goal` [m]."""
        thickness = strip.spread.get("thickness", (strip.thickness, strip.thickness))
        self._distances = (max(thickness[0], THINNEST), max(thickness[1], THINNEST))
        self._goal = goal
        self._span = strip.length - goal
        self._most = strip.length + LENGTH_ERROR  # m, of a plausible fall
        self._falls: list[Fall] = []
        self._touch: SeenTouch | None = None

    def update(self, measurement: StripMeasurement, gripper: Pose) -> SeenTouch | None:
        """Add a measurement; returns the layers' touch once it is certain, until then
        None.

        `gripper` is the measured pose at the measurement's stamp. The touch's own time
        is earlier.
        """
        if self._touch is None:
            fall = _fall(measurement, gripper)
            last = self._falls[-1].time if self._falls else -np.inf
            if (
                fall is not None
                and fall.time > last
                and fall.x + fall.to_grasped < self._most
            ):
                self._falls = [*self._falls, fall][-FALLS_KEPT:]
                self._touch = self._find_touch()
        return self._touch

    def resting(self) -> float:
        """Gap [m] at which the layers rest without touching; NaN while they fall or
        touch.
        """
        recent = [fall.gap for fall in self._falls[-RESTING_FALLS:]]
        rests = len(recent) == RESTING_FALLS and max(recent) - min(recent) < MARGIN
        if self._touch is not None or not rests:
            return nan
        distance = float(np.median(recent))
        return distance if distance > self._distances[1] + MARGIN else nan

    def _find_touch(self) -> SeenTouch | None:
        """Layers' touch found in the images so far; None while gap and fall do not both
        show it.
        """
        t = np.array([fall.time for fall in self._falls])
        gap = np.array([fall.gap for fall in self._falls])
        recent = gap[-RECENT_FALLS:]
        distance = float(np.clip(np.median(recent), *self._distances))
        if len(gap) < FEWEST_FALLS or not (recent < distance + MARGIN).all():
            return None

        # the first signal: the gap closes
        closing = _closing_time(t, gap, distance + MARGIN, distance)
        if closing is None:
            return None
        closed, speed = closing

        # the second: the fold stops falling, at about that time
        if not _falls_slower(t, gap, closed, STOP_SHARE * speed):
            return None
        disagreement = abs(_end_of_fall(t, gap, closed, speed) - closed) / AGREEMENT
        if disagreement > LARGEST_RATIO:
            return None

        x, displacement = self._position_at(closed, t)
        touch = SeenTouch(
            time=closed,
            x=x,
            to_grasped=x + displacement,
            to_fixed=x,
            goal=self._goal,
            confidence=exp(-disagreement),
            distance=distance,
        )
        return touch if self._is_a_fold(touch) else None

    def _position_at(self, time: float, t: Array) -> tuple[float, float]:
        """Position x [m] and displacement [m] of the fold at `time` [s], from its
        falling images at times `t` (n,) [s].

        Both lengths err alike where the place is misread: their difference is filtered.
        """
        positions = _without_spikes([fall.x for fall in self._falls])
        differences = _without_spikes(
            [fall.to_grasped - fall.x for fall in self._falls]
        )
        x = float(np.interp(time, t, positions))
        return x, float(np.interp(time, t, differences))

    def _is_a_fold(self, touch: SeenTouch) -> bool:
        """Whether a touch has lengths that a fold can have; touches near the strip's
        end are misread.
        """
        is_inside = touch.to_fixed > self._goal
        return is_inside and abs(touch.displacement) <= UNEVEN * self._span


def _fall(measurement: StripMeasurement, gripper: Pose) -> Fall | None:
    """Falling fold in one measurement; None where no gap between the layers is
    visible.
    """
    gap_x = measurement.gap_x
    if not np.isfinite(measurement.gap) or len(measurement.profile) < 4:
        return None

    points = np.vstack([measurement.profile, [(gripper.x, gripper.z)]])
    x, _ = points.T
    steps = lengths(np.diff(points, axis=0))
    remaining = running_sums(steps[::-1])[::-1]  # m to the gripper

    # the upper layer leads from the tip back over the gap
    tip = np.argmax(x)
    past_gap = np.flatnonzero(x[tip:] <= gap_x)
    if len(past_gap) == 0 or past_gap[0] == 0:
        return None

    after = tip + past_gap[0]
    before = after - 1
    fraction = (x[before] - gap_x) / (x[before] - x[after])
    to_grasped = remaining[before] + fraction * (remaining[after] - remaining[before])
    return Fall(
        time=measurement.stamp,
        gap=measurement.gap,
        x=gap_x,
        to_grasped=float(to_grasped),
    )


def _closing_time(
    t: Array, gap: Array, level: float, end: float
) -> tuple[float, float] | None:
    """Time [s] at which the layers' gap closed to `end` [m], and its closing speed
    [m/s]; None if it stays open.

    The last gap above `level` is extrapolated to `end` at the slope of the last three,
    no later than the next image allows: later gaps may be at rest already.
    """
    crossings = np.flatnonzero((gap[:-1] > level) & (gap[1:] <= level))
    if len(crossings) == 0 or crossings[-1] == 0:
        return None
    last = crossings[-1]  # above `level`
    three = slice(max(last - 2, 0), last + 1)
    speed = -float(np.polyfit(t[three], gap[three], 1)[0])
    if speed <= 0:
        return None

    t_before, t_after = t[last : last + 2]
    before, after = gap[last : last + 2]
    closed = t_before + (before - end) / speed
    latest = t_after + max(after - end, 0.0) / speed
    return float(min(closed, latest)), speed


def _falls_slower(t: Array, gap: Array, time: float, speed: float) -> bool:
    """Whether the layers' gap (n,) closes at `speed` [m/s] or slower from `time` [s]
    on; False for too few images.
    """
    after = t >= time
    if after.sum() < RECENT_FALLS:
        return False
    closing = -np.polyfit(t[after], gap[after], 1)[0]
    return not closing > speed


def _end_of_fall(t: Array, gap: Array, time: float, speed: float) -> float:
    """Time [s] at which a fold stopped falling: where its last gap above that at
    rest, which closes at `speed` [m/s], meets it.
    """
    rest = np.median(gap[t >= time])
    moving = gap > rest + RISE_SHARE * speed * np.median(np.diff(t))
    # noise at rest may rise again: the first stop counts
    last = np.argmin(moving) - 1
    return float(t[last] + (gap[last] - rest) / speed)


def _without_spikes(values: Sequence[float]) -> Array:
    """Running median (n,) over three of `values` (n,), which drops single outliers."""
    threes = np.lib.stride_tricks.sliding_window_view(np.pad(values, 1, mode="edge"), 3)
    medians: Array = np.median(threes, axis=1)
    return medians
