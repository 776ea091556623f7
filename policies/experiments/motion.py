"""Predefined gripper motions, a path and the distance along it over time.

Their policy executes one whatever the images show.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from drivers.base.geometry import arc_lengths, lengths
from drivers.base.types import Array
from drivers.strip.file import StripFile
from policies.path import Path
from policies.policy import Decision, Observation

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline


@dataclass(frozen=True, slots=True)
class Go:
    """Part of a motion: move along the path, forward or back, to the fraction `to` of
    it.
    """

    to: float


@dataclass(frozen=True, slots=True)
class Rest:
    """Part of a motion: rest for `duration` [s]."""

    duration: float


@dataclass(frozen=True, slots=True)
class Shake:
    """Part of a motion: swing along x by `amplitude` [m] at `frequency` [Hz] for
    `cycles`.
    """

    amplitude: float
    frequency: float
    cycles: int

    @property
    def duration(self) -> float:
        """Duration [s] of the shaking."""
        return self.cycles / self.frequency

    def offset(self, time: Array) -> Array:
        """Displacement (...,) [m] along x at `time` (...,) [s] after the start, with
        both fades.
        """
        to_nearer_end = np.minimum(time, self.duration - time)
        swell = np.clip(2.0 * to_nearer_end * self.frequency, 0.0, 1.0)
        return self.amplitude * swell * np.sin(2 * np.pi * self.frequency * time)


Part = Go | Rest | Shake


@dataclass(frozen=True, slots=True)
class Motion:
    """Planned gripper motion along `path`, over the time since its start.

    `times` (k,) [s] and `travels` (k,) [m] are the corners of the distance along the
    path over time; `shakes` are paired with the times [s] at which they begin.
    """

    path: Path
    times: Array
    travels: Array
    shakes: tuple[tuple[float, Shake], ...]

    @property
    def duration(self) -> float:
        """Duration [s] of the motion."""
        return float(self.times[-1])

    def at(self, time: Array | float) -> Array:
        """Gripper points (..., 2) x, z [m] at `time` (...,) [s] since the start."""
        points = self.path.at(self.travel(time))
        for begin, shake in self.shakes:
            since = np.asarray(time) - begin
            inside = (since > 0.0) & (since < shake.duration)
            points[..., 0] += np.where(inside, shake.offset(since), 0.0)
        return points

    def travel(self, time: Array | float) -> Array:
        """Distance (...,) [m] along the path at `time` (...,) [s] since the start."""
        return np.asarray(np.interp(time, self.times, self.travels))

    def passing(self, travel: float) -> float:
        """Time [s] at which the motion first reaches `travel` [m] along the path."""
        k = max(1, int(np.argmax(self.travels >= travel)))
        return float(
            np.interp(travel, self.travels[k - 1 : k + 1], self.times[k - 1 : k + 1])
        )


def motion(path: Path, parts: Sequence[Part], speed: float) -> Motion:
    """Compose a motion along `path` at `speed` [m/s] of `parts`, in order."""
    times = [0.0]
    travels = [0.0]
    shakes = []
    for part in parts:
        time = times[-1]
        travel = travels[-1]
        if isinstance(part, Go):
            target = part.to * path.length
            times.append(time + abs(target - travel) / speed)
            travels.append(target)
            continue
        if isinstance(part, Shake):
            shakes.append((time, part))
        times.append(time + part.duration)
        travels.append(travel)

    return Motion(
        path=path,
        times=np.array(times),
        travels=np.array(travels),
        shakes=tuple(shakes),
    )


# s to either side over which the velocity of the motion is averaged: a gripper turns no
# sharp corner; cut off at both ends of the motion, where the speed fades in and out
HALF_SPAN = 0.03
GAIN = 4.0  # 1/s, of the feedback of the position error
FASTEST_COMMAND = 0.19  # m/s, limit of the commanded speed
SEARCH_SAMPLES = 2001  # points of a path among which the nearest is searched


class ScriptedPolicy:
    """Policy that executes the motion which `draw(length, speed)` returns for a strip's
    length [m] and a speed [m/s].

    The lift is along the motion's path; at the first decision the motion's clock is set
    to the gripper's position on it.
    """

    def __init__(self, name: str, draw: Callable[[float, float], Motion]) -> None:
        self.name = name
        self._draw = draw

    def reset(self, strip: StripFile, speed: float, count: int) -> None:
        """Create the motion for `strip` at `speed` [m/s], for `count` grippers at its
        start.
        """
        self._motion = self._draw(strip.length, speed)
        # NaN before the first decision
        self._start_times: Array = np.full(count, np.nan)

    def lift(self) -> Path:
        """Path of the lift, which is the motion's whole path."""
        return self._motion.path

    def decide(self, observation: Observation) -> Decision:
        """Command the motion's velocity with position feedback; done at the motion's
        end.
        """
        motion = self._motion
        points = np.stack([observation.x, observation.z], axis=-1)
        if np.isnan(self._start_times).any():
            self._start_times = observation.time - self._passed(points)
        elapsed = observation.time - self._start_times

        target = motion.at(np.clip(elapsed, 0.0, motion.duration))
        before = motion.at(np.clip(elapsed - HALF_SPAN, 0.0, motion.duration))
        after = motion.at(np.clip(elapsed + HALF_SPAN, 0.0, motion.duration))
        velocity = (after - before) / (2 * HALF_SPAN) + GAIN * (target - points)

        done = elapsed >= motion.duration
        speed = np.where(done, 0.0, np.minimum(lengths(velocity), FASTEST_COMMAND))
        direction = np.arctan2(velocity[:, 1], velocity[:, 0]) % (2 * np.pi)
        return Decision(direction, speed, done)

    def _passed(self, points: Array) -> Array:
        """Times (n,) [s] at which the motion passes nearest to `points` (n, 2)."""
        path = self._motion.path
        travel = np.linspace(0.0, path.length, SEARCH_SAMPLES)
        gaps = np.linalg.norm(path.at(travel)[:, None] - points, axis=-1)
        nearest = travel[np.argmin(gaps, axis=0)]
        return np.array([self._motion.passing(s) for s in nearest])


STEP = 0.001  # s
SPEED_RANGE = (0.06, 0.15)  # m/s
HASTE = 0.3  # one sigma of the logarithm of the speed over its mean
MOST_STOPS = 2  # on the way
PAUSE_RANGE = (0.3, 1.5)  # s that a stop lasts
STOP_RANGE = (0.2, 0.8)  # of the path, in which the stops lie
RETURN_SHARE = 0.5  # of the motions with a stop, share that goes back from it
RETURN_RANGE = (0.03, 0.10)  # of the path, by which it goes back
WAVER = (0.1, 0.6)  # Hz, band in which the speed varies
STARTING = 0.5  # s in which a hand comes up to speed, and to rest
WAVES = 6  # sines of a random signal
HAND_STREAM = 2  # number of this stream among the random generators of a seed
PATH_SAMPLES = 2001  # points of a path as a polyline
CURVE_SAMPLES = 400  # points by which a curve's arc length is measured


def generator(seed: int, number: int) -> np.random.Generator:
    """Random number generator for motion `number` of the simulated person `seed`."""
    return np.random.default_rng([seed, HAND_STREAM, number])


def human_motion(length: float, seed: int, number: int) -> Motion:
    """Motion `number` of the simulated person `seed` over a strip of `length` [m],
    without tremor.
    """
    line, travel = hand_path(length, generator(seed, number))
    samples = np.linspace(0.0, line.x[-1], PATH_SAMPLES)
    times: Array = STEP * np.arange(len(travel), dtype=float)
    return Motion(Path.through(line(samples)), times, travel, shakes=())


def hand_path(length: float, rng: np.random.Generator) -> tuple["CubicSpline", Array]:
    """Draw a path by hand: spline x, z [m] over distance [m], and distance (n,) [m]
    every STEP.

    From the grasped edge of a strip of `length` [m] up, then over to its fixed edge,
    with pauses and returns.
    """
    from scipy.interpolate import CubicSpline, PchipInterpolator

    apex = (rng.uniform(0.42, 0.58), rng.uniform(0.40, 0.55))
    # x, z over the strip's length, from the grasped edge to the fixed one
    knots = np.array(
        [
            (1.0, 0.0),
            (1.0 - rng.uniform(0.002, 0.008), rng.uniform(0.05, 0.07)),
            (rng.uniform(0.84, 0.90), rng.uniform(0.20, 0.26)),
            apex,
            (rng.uniform(0.18, 0.26), rng.uniform(0.24, 0.32)),
            (rng.uniform(0.0, 0.03), rng.uniform(0.04, 0.06)),
        ]
    )
    chords = arc_lengths(knots)
    samples = np.linspace(0.0, chords[-1], CURVE_SAMPLES)
    points = PchipInterpolator(chords, length * knots)(samples)
    line = CubicSpline(arc_lengths(points), points)
    return line, _travel(float(line.x[-1]), rng)


def _travel(length: float, rng: np.random.Generator) -> Array:
    """Distance (n,) [m] along a path of `length` every STEP, in strokes from rest, with
    pauses.
    """
    stops = [*np.sort(rng.uniform(*STOP_RANGE, rng.integers(MOST_STOPS + 1))), 1.0]
    if rng.uniform() < RETURN_SHARE and len(stops) > 1:
        stops.insert(1, stops[0] - rng.uniform(*RETURN_RANGE))

    speed = rng.uniform(*SPEED_RANGE)
    start = 0.0
    parts = [np.zeros(1)]

    for stop in length * np.array(stops):
        parts.append(_stroke(start, stop, speed, rng))
        pause = rng.uniform(*PAUSE_RANGE)
        parts.append(np.full(round(pause / STEP), stop))
        start = stop

    return np.concatenate(parts)


def _stroke(begin: float, end: float, speed: float, rng: np.random.Generator) -> Array:
    """Distances (n,) along the path from `begin` to `end` [m] at about `speed`, rest to
    rest.
    """
    t = np.arange(0.0, abs(end - begin) / speed + STARTING, STEP)
    pace = np.exp(HASTE * wavering(t, WAVER, rng))
    ramp = np.clip(np.minimum(t, t[-1] - t) / STARTING, 0.0, 1.0)
    covered = np.cumsum(pace * np.sin(0.5 * np.pi * ramp) ** 2)
    distances: Array = begin + (end - begin) * covered / covered[-1]
    return distances


def wavering(t: Array, band: tuple[float, float], rng: np.random.Generator) -> Array:
    """Draw a smooth signal (n,) at times `t` (n,) [s], of unit variance, frequencies in
    `band`.
    """
    frequency = rng.uniform(*band, WAVES)
    phase = rng.uniform(0.0, 2.0 * np.pi, WAVES)
    waves = np.sin(2.0 * np.pi * np.outer(t, frequency) + phase)
    signal: Array = waves.sum(axis=1) * np.sqrt(2.0 / WAVES)
    return signal
