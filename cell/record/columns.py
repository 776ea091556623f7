"""Columns of a run's tables as checked arrays."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Self

import numpy as np
import pyarrow as pa

from drivers.errors import ConfigurationError
from drivers.types import Array, Pose, frozen

FARTHEST_HAND = 5.0  # m, further from the fixed edge nothing of a cell can be
FULL_TURN = 2 * np.pi
FARTHEST_POINT = 100.0  # m, further than any camera of a cell sees, however wrong a point may be
LONGEST_TIME = 1e5  # s, longer than a day
LARGEST_VALUE = 1e9  # nothing of a cell is as large in any unit
MUST = ("t", "x", "z")
MOTION_COLUMNS = ("pitch", "x_cmd", "z_cmd")  # finite where there are such columns
Limit = tuple[float, str]  # largest absolute value, and its unit
TIME, PLACE, ANY = (LONGEST_TIME, "s"), (FARTHEST_HAND, "m"), (LARGEST_VALUE, "SI units")
TICK_LIMITS: dict[str, Limit] = {
    "t": TIME, "x": PLACE, "z": PLACE, "pitch": (FULL_TURN, "rad"), "x_cmd": PLACE, "z_cmd": PLACE,
    "contact_x": PLACE, "contact_t": ANY, "f_x": ANY, "f_z": ANY, "image_age": ANY,
}  # fmt: skip
PROFILE_LIMITS: dict[str, Limit] = {
    "t": TIME, "i": (np.inf, ""), "x": (FARTHEST_POINT, "m"), "z": (FARTHEST_POINT, "m"),
}  # fmt: skip


class Columns:
    """Base of the columns of a table of a run, as arrays (n,)."""

    __slots__: tuple[str, ...] = ()

    @classmethod
    def none(cls) -> Self:
        """Columns without rows."""
        return cls(**{name: frozen([]) for name in cls.__slots__ if name != "state"})


@dataclass(frozen=True, slots=True)
class Ticks(Columns):
    """Columns of ticks.parquet as arrays (n,) in s, m, rad, N; NaN where not measured.

    `state` and `image_age` are those of a run of the cell, empty and NaN in others.
    """

    t: Array
    x: Array
    z: Array
    pitch: Array
    x_cmd: Array
    z_cmd: Array
    contact_x: Array
    contact_t: Array
    f_x: Array
    f_z: Array
    image_age: Array
    state: tuple[str, ...] = ()

    @classmethod
    def parse(cls, table: pa.Table, origin: str) -> Self:
        """Check `table`, return its ticks; ConfigurationError names `origin` and the column."""
        values = _read(table, TICK_LIMITS, origin, must=MUST, finite=(*MUST, *MOTION_COLUMNS))
        _check_order(values["t"], origin, strictly=True)
        state = table["state"].to_pylist() if table.column_names.count("state") == 1 else []
        return cls(**values, state=tuple(str(name) for name in state))

    def pose_at(self, stamp: float) -> Pose:
        """Gripper pose at `stamp` [s], interpolated between ticks."""
        columns = self.x, self.z, self.pitch
        return Pose(*(float(np.interp(stamp, self.t, column)) for column in columns))


@dataclass(frozen=True, slots=True)
class Profile(Columns):
    """Columns of profile.parquet, arrays (n,): stamp `t` [s], order `i`, points `x`, `z` [m]."""

    t: Array
    i: Array
    x: Array
    z: Array

    @classmethod
    def parse(cls, table: pa.Table, origin: str) -> Self:
        """Check `table`, return its profile; ConfigurationError names `origin` and the column."""
        for name in ("x", "z"):
            _check_median(_numbers(table, name, origin), name, origin)
        values = _read(table, PROFILE_LIMITS, origin, must=PROFILE_LIMITS, finite=PROFILE_LIMITS)
        _check_order(values["t"], origin, strictly=False)
        return cls(**values)

    def curves(self) -> list[tuple[float, Array]]:
        """Midlines of the strip in order of time: stamp [s] and points (m, 2) [m] of each image."""
        points = np.stack([self.x, self.z], axis=1)
        # rows at which an image begins, and the end: a difference to NaN counts as nonzero
        edges = np.flatnonzero(np.diff(self.t, prepend=np.nan, append=np.nan))
        return [
            (float(self.t[start]), points[start:end][np.argsort(self.i[start:end], kind="stable")])
            for start, end in pairwise(edges)
        ]


@dataclass(frozen=True, slots=True)
class Sights(Columns):
    """Columns of sights.parquet as arrays (n,): measurement of the strip in every image."""

    stamp: Array
    sequence: Array
    contact_x: Array
    contact_confidence: Array
    profile_confidence: Array
    tip_x: Array
    tip_z: Array
    gap: Array
    gap_x: Array

    @classmethod
    def parse(cls, table: pa.Table, origin: str) -> Self:
        """Check `table`, return its sights; ConfigurationError names `origin` and the column."""
        limits, finite = dict.fromkeys(cls.__slots__, ANY), ("stamp", "sequence")
        values = _read(table, limits, origin, must=limits, finite=finite)
        return cls(**values)


def _read(
    table: pa.Table,
    limits: Mapping[str, Limit],
    origin: str,
    must: Collection[str],
    finite: Collection[str],
) -> dict[str, Array]:
    """Columns (n,) by name, within their `limits`; NaN for one that is not there nor in `must`."""
    values = {}
    for name, (limit, unit) in limits.items():
        if name not in must and name not in table.column_names:
            values[name] = frozen(np.full(table.num_rows, np.nan))
            continue
        values[name] = _numbers(table, name, origin)
        if name in finite:
            _check_finite(values[name], name, origin)
        _check_range(values[name], name, origin, limit, unit)
    return values


def _numbers(table: pa.Table, name: str, origin: str) -> Array:
    if name not in table.column_names:
        raise ConfigurationError(f"{origin}: {name}: the column is missing; add it")
    if table.column_names.count(name) > 1:
        raise ConfigurationError(f"{origin}: {name}: there are two such columns; keep one")
    column = table[name]
    if not (pa.types.is_floating(column.type) or pa.types.is_integer(column.type)):
        raise ConfigurationError(f"{origin}: {name}: holds {column.type}, must hold numbers")
    try:
        return frozen(column.cast(pa.float64(), safe=False).to_numpy())
    except pa.ArrowException as error:
        raise ConfigurationError(f"{origin}: {name}: cannot be read: {error}") from None


def _check_finite(values: Array, name: str, origin: str) -> None:
    wrong = np.flatnonzero(~np.isfinite(values))
    if wrong.size:
        raise ConfigurationError(
            f"{origin}: {name}: row {wrong[0]} is {values[wrong[0]]}, must be a finite number; "
            "leave rows out that were not measured"
        )


def _check_order(t: Array, origin: str, strictly: bool) -> None:
    steps = np.diff(t)
    wrong = np.flatnonzero(steps <= 0 if strictly else steps < 0)
    if wrong.size:
        row = int(wrong[0]) + 1
        raise ConfigurationError(
            f"{origin}: t: row {row} is {t[row]:g} s after {t[row - 1]:g} s, times must increase"
        )


def _check_median(values: Array, name: str, origin: str) -> None:
    """Refuse lengths in a wrong unit by their median, which outliers do not change."""
    middle = float(np.median(np.abs(values))) if values.size else 0.0
    if middle > FARTHEST_HAND:
        raise ConfigurationError(
            f"{origin}: {name}: is {middle:.3g} in the middle, must stay within "
            f"{FARTHEST_HAND:g} m; give it in m"
        )


def _check_range(values: Array, name: str, origin: str, limit: float, unit: str) -> None:
    known = values[~np.isnan(values)]
    largest = float(np.max(np.abs(known), initial=0.0))
    if largest > limit:
        raise ConfigurationError(
            f"{origin}: {name}: reaches {largest:.6g}, must stay within {limit:.3g} {unit}; "
            f"give it in {unit}"
        )
