"""Data for drawing a measured or simulated run: its curve, points and signals."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from drivers.types import Array


@dataclass(frozen=True, slots=True)
class Curve:
    """Moving curve: for each of the times `t` (m,) [s], its `points` (k, 2) in x and z [m]."""

    t: Array
    points: tuple[Array, ...]


@dataclass(frozen=True, slots=True)
class Track:
    """Moving point: its positions `places` (m, 2) in x and z [m] at the times `t` (m,) [s]."""

    t: Array
    places: Array


@dataclass(frozen=True, slots=True)
class Signal:
    """Time series to plot: `values` (m,) at times `t` (m,) [s]; equal titles share a plot."""

    title: str
    t: Array
    values: Array


@dataclass(frozen=True, slots=True)
class Scene:
    """Drawing of a measured or simulated run; `tracks` by name, `events` as (time [s], label)."""

    signals: tuple[Signal, ...]
    curve: Curve | None = None
    tracks: Mapping[str, Track] = field(default_factory=dict)
    events: tuple[tuple[float, str], ...] = ()
