"""Columns of a run's tables as arrays, checked."""

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Self

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from drivers.errors import ConfigurationError
from drivers.settings import SCHEMA
from drivers.types import Array, frozen

REACH = 5.0  # m, further from the fixed edge nothing of a cell can be
TURN = 2 * np.pi


@dataclass(frozen=True, slots=True)
class Ticks:
    """ticks.parquet: arrays (n,) in seconds, metres, radians, newtons; NaN where not measured.

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
    state: tuple[str, ...]

    @classmethod
    def of(cls, table: pa.Table, origin: str) -> Self:
        """The columns of `table`; ConfigurationError names `origin` and the column at fault."""
        must = ("t", "x", "z", "pitch", "x_cmd", "z_cmd")
        values = {name: _numbers(table, name, origin) for name in (*must, "contact_x")}
        for name in must:
            _check_finite(values[name], name, origin)
        _check_order(values["t"], origin, strictly=True)
        for name in ("x", "z", "x_cmd", "z_cmd", "contact_x"):
            _check_range(values[name], name, origin, REACH, "m")
        _check_range(values["pitch"], "pitch", origin, TURN, "rad")
        for name in ("contact_t", "f_x", "f_z", "image_age"):
            values[name] = _optional(table, name, origin)
        state = table["state"].to_pylist() if "state" in table.column_names else []
        return cls(**values, state=tuple(str(name) for name in state))


@dataclass(frozen=True, slots=True)
class Profile:
    """profile.parquet: arrays (n,), stamp `t` [s], order `i`, points `x`, `z` [m]."""

    t: Array
    i: Array
    x: Array
    z: Array

    @classmethod
    def of(cls, table: pa.Table, origin: str) -> Self:
        """The columns of `table`; ConfigurationError names `origin` and the column at fault."""
        values = {name: _numbers(table, name, origin) for name in ("t", "i", "x", "z")}
        for name, column in values.items():
            _check_finite(column, name, origin)
        _check_order(values["t"], origin, strictly=False)
        return cls(**values)

    def curves(self) -> list[tuple[float, Array]]:
        """Stamp [s] and points (m, 2) [m] of each image, in order."""
        points = np.stack([self.x, self.z], axis=1)
        edges = np.flatnonzero(np.diff(self.t, prepend=np.nan, append=np.nan))
        return [
            (float(self.t[a]), points[a:b][np.argsort(self.i[a:b], kind="stable")])
            for a, b in pairwise(edges)
        ]


@dataclass(frozen=True, slots=True)
class Sights:
    """sights.parquet: a `StripMeasurement` per image as arrays (n,); empty where not kept."""

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
    def of(cls, table: pa.Table, origin: str) -> Self:
        """The columns of `table`; ConfigurationError names `origin` and the column at fault."""
        return cls(**{name: _numbers(table, name, origin) for name in cls.__slots__})

    @classmethod
    def none(cls) -> Self:
        """No image at all."""
        return cls(*[frozen([]) for _ in cls.__slots__])


def read_parquet(path: Path) -> pa.Table:
    """A Parquet table; ConfigurationError when it is missing, broken or of a newer schema."""
    try:
        table = pq.read_table(path)
    except FileNotFoundError:
        raise ConfigurationError(f"{path}: is missing") from None
    except (pa.ArrowException, OSError) as error:
        reason = str(error).splitlines()[0]
        raise ConfigurationError(f"{path}: is not a whole Parquet file: {reason}") from None
    schema = (table.schema.metadata or {}).get(b"schema", b"1").decode(errors="replace")
    if not schema.isdigit() or int(schema) > SCHEMA:
        raise ConfigurationError(
            f"{path}: schema: is {schema}, this version reads {SCHEMA}; update the cell"
        )
    return table


def _numbers(table: pa.Table, name: str, origin: str) -> Array:
    if name not in table.column_names:
        raise ConfigurationError(f"{origin}: {name}: the column is missing; add it")
    column = table[name]
    if not (pa.types.is_floating(column.type) or pa.types.is_integer(column.type)):
        raise ConfigurationError(f"{origin}: {name}: holds {column.type}, must hold numbers")
    return frozen(column.cast(pa.float64()).to_numpy())


def _optional(table: pa.Table, name: str, origin: str) -> Array:
    if name in table.column_names:
        return _numbers(table, name, origin)
    return frozen(np.full(table.num_rows, np.nan))


def _check_finite(values: Array, name: str, origin: str) -> None:
    wrong = np.flatnonzero(~np.isfinite(values))
    if wrong.size:
        raise ConfigurationError(
            f"{origin}: {name}: row {wrong[0]} is {values[wrong[0]]}, must be a finite number"
        )


def _check_order(t: Array, origin: str, strictly: bool) -> None:
    steps = np.diff(t)
    wrong = np.flatnonzero(steps <= 0 if strictly else steps < 0)
    if wrong.size:
        row = int(wrong[0]) + 1
        raise ConfigurationError(
            f"{origin}: t: row {row} is {t[row]} s after {t[row - 1]} s, times must increase"
        )


def _check_range(values: Array, name: str, origin: str, limit: float, unit: str) -> None:
    largest = float(np.nanmax(np.abs(values), initial=0.0))
    if largest > limit:
        raise ConfigurationError(
            f"{origin}: {name}: reaches {largest:.6g}, must stay within {limit:.3g} {unit}; "
            f"give it in {unit}"
        )
