"""Predefined gripper motions: a path, and the distance along it over time."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drivers.base.types import Array
from policies.path import Path


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
        return np.asarray(
            self.amplitude * swell * np.sin(2 * np.pi * self.frequency * time)
        )


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
    times, travels = [0.0], [0.0]
    shakes = []
    for part in parts:
        time, travel = times[-1], travels[-1]
        if isinstance(part, Go):
            target = part.to * path.length
            times.append(time + abs(target - travel) / speed)
            travels.append(target)
            continue
        if isinstance(part, Shake):
            shakes.append((time, part))
        times.append(time + part.duration)
        travels.append(travel)
    return Motion(path, np.array(times), np.array(travels), tuple(shakes))
