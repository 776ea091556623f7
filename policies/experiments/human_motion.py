"""Random gripper motions, as of a person who guides the gripper over the strip by
hand.
"""

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator

from drivers.base.geometry import arc_lengths
from drivers.base.types import Array
from policies.experiments.motion import Motion
from policies.path import Path

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
    """Motion `number` of the simulated person `seed` over a strip of `length` [m], no
    tremor.
    """
    line, travel = hand_path(length, generator(seed, number))
    samples = np.linspace(0.0, line.x[-1], PATH_SAMPLES)
    times: Array = STEP * np.arange(len(travel), dtype=float)
    return Motion(Path.through(line(samples)), times, travel, shakes=())


def hand_path(length: float, rng: np.random.Generator) -> tuple[CubicSpline, Array]:
    """Draw a path by hand: spline x, z [m] over distance [m], and distance (n,) [m]
    every STEP.

    From the grasped edge of a strip of `length` [m] up, then over to its fixed edge,
    with pauses and returns.
    """
    apex = (rng.uniform(0.42, 0.58), rng.uniform(0.40, 0.55))
    # x, z over the strip's length, from the grasped edge to the fixed one
    places = np.array(
        [
            (1.0, 0.0),
            (1.0 - rng.uniform(0.002, 0.008), rng.uniform(0.05, 0.07)),
            (rng.uniform(0.84, 0.90), rng.uniform(0.20, 0.26)),
            apex,
            (rng.uniform(0.18, 0.26), rng.uniform(0.24, 0.32)),
            (rng.uniform(0.0, 0.03), rng.uniform(0.04, 0.06)),
        ]
    )
    chords = arc_lengths(places)
    samples = np.linspace(0.0, chords[-1], CURVE_SAMPLES)
    points = PchipInterpolator(chords, length * places)(samples)
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
    return np.asarray(begin + (end - begin) * covered / covered[-1])


def wavering(t: Array, band: tuple[float, float], rng: np.random.Generator) -> Array:
    """Draw a smooth signal (n,) at times `t` (n,) [s], of unit variance, frequencies in
    `band`.
    """
    frequency = rng.uniform(*band, WAVES)
    phase = rng.uniform(0.0, 2.0 * np.pi, WAVES)
    waves = np.sin(2.0 * np.pi * np.outer(t, frequency) + phase)
    return np.asarray(waves.sum(axis=1) * np.sqrt(2.0 / WAVES))
