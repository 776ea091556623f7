"""Parquet tables of a run, made from its streams; the same rows give the same bytes."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray

from cell.record.events import lift_time
from cell.record.files import PROFILE, SIGHT_STREAM, SIGHTS, TICK_STREAM, TICKS
from cell.record.stream import SIGHT_ROWS, TICK_ROWS, read_stream
from drivers.errors import ConfigurationError
from drivers.files import replacing
from drivers.readers import SCHEMA
from drivers.types import Array

TIME_ROUNDING = 1e-9  # s


@dataclass(frozen=True, slots=True)
class Tables:
    """Tables of a run: `ticks`, `profile` (points of midlines), `sights` (one row per image)."""

    ticks: pa.Table
    profile: pa.Table
    sights: pa.Table


def assemble(folder: Path) -> Tables:
    """Make the tables of a run from its streams, complete or truncated.

    Raises ConfigurationError when a stream cannot be read or was changed after the run.
    """
    begin = lift_time(folder)
    ticks = _from_time(begin, read_stream(folder / TICK_STREAM, TICK_ROWS), "t")
    sights = _from_time(begin, read_stream(folder / SIGHT_STREAM, SIGHT_ROWS), "stamp")
    _check_profiles(sights, folder / SIGHT_STREAM)
    with np.errstate(all="ignore"):  # readers of the tables refuse values that are not finite
        return Tables(
            ticks=tick_table(ticks, sights),
            profile=profile_table(sights),
            sights=sights.drop_columns(["profile_x", "profile_z"]),
        )


def _check_profiles(sights: pa.Table, path: Path) -> None:
    """Refuse rows without a profile, or with one of unequal coordinates."""
    x, z = (pc.list_value_length(sights[name]) for name in ("profile_x", "profile_z"))
    if x.null_count or z.null_count or not x.equals(z):
        raise ConfigurationError(
            f"{path}: rows do not fit each other: a profile has no or unequal coordinates; it was "
            "changed after the run"
        )


def _from_time(begin: float, rows: pa.Table, time: str) -> pa.Table:
    """Rows from `begin` [s] on, with their column `time` relative to it; all rows for 0."""
    if begin == 0.0:
        return rows
    t = _numbers(rows, time) - begin
    kept = t >= -TIME_ROUNDING
    rows = rows.filter(pa.array(kept))
    place = rows.column_names.index(time)
    return rows.set_column(place, rows.schema.field(place), pa.array(t[kept], pa.float64()))


def tick_table(ticks: pa.Table, sights: pa.Table) -> pa.Table:
    """Table of ticks, with each contact in the row nearest to its image's stamp.

    A row whose stamp did not advance contains no new measurement and is left out, and so are one
    of an arm that reported no number, which no reader takes, and columns of computing time, which
    differ from run to run.
    """
    t = _numbers(ticks, "t")
    latest = np.maximum.accumulate(np.concatenate([[-np.inf], t]))[:-1]  # stamp before each row
    finite = np.isfinite([_numbers(ticks, name) for name in ("x", "z", "pitch")]).all(axis=0)
    ticks = ticks.filter(pa.array((t > latest) & finite))
    t = _numbers(ticks, "t")
    contact_x, contact_t = place_contacts(
        t, _numbers(sights, "stamp"), _numbers(sights, "contact_x")
    )
    columns = {name: ticks[name] for name in ("t", "x", "z", "pitch", "x_cmd", "z_cmd")}
    columns |= {"contact_x": pa.array(contact_x), "contact_t": pa.array(contact_t)}
    columns |= {name: ticks[name] for name in ("f_x", "f_z", "image_age", "state")}
    return pa.table(columns)


def place_contacts(t: Array, stamp: Array, contact_x: Array) -> tuple[Array, Array]:
    """Contacts and their stamps as columns over `t` (n,), NaN where no image belongs.

    Of two images nearest to one row the nearer is used; images outside the rows are dropped.
    """
    placed_x, placed_t = np.full(t.size, np.nan), np.full(t.size, np.nan)
    if t.size < 2:
        return placed_x, placed_t
    reach = 0.5 * float(np.median(np.diff(t)))
    keep = np.isfinite(contact_x) & (stamp >= t[0] - reach) & (stamp <= t[-1] + reach)
    stamp, contact_x = stamp[keep], contact_x[keep]
    row = place_rows(t, stamp)
    nearest_last = np.argsort(-np.abs(t[row] - stamp), kind="stable")
    placed_x[row[nearest_last]] = contact_x[nearest_last]  # the last assignment to a row stays
    placed_t[row[nearest_last]] = stamp[nearest_last]
    return placed_x, placed_t


def place_rows(t: Array, stamps: Array) -> NDArray[np.intp]:
    """Rows (k,) of the two or more increasing `t` (n,) that are nearest to `stamps` (k,)."""
    after = np.clip(np.searchsorted(t, stamps), 1, t.size - 1)
    nearer = stamps - t[after - 1] <= t[after] - stamps
    return np.asarray(np.where(nearer, after - 1, after), dtype=np.intp)


def profile_table(sights: pa.Table) -> pa.Table:
    """Table of points t, i, x, z of all images, in the order of their stamps."""
    counts = [len(points) for points in sights["profile_x"].to_pylist()]
    return pa.table(
        {
            "t": pa.array(np.repeat(_numbers(sights, "stamp"), counts), pa.float64()),
            "i": pa.array([i for count in counts for i in range(count)], pa.int64()),
            "x": _flatten(sights["profile_x"]),
            "z": _flatten(sights["profile_z"]),
        }
    )


def joint_table(rows: Array, origin: float) -> pa.Table:
    """Table of a robot's joints: column `t`, relative to `origin` [s], and `q_1` to `tau_J_7`.

    Its `rows` (n, 29) hold t [s] on the cell's clock, then q, dq, q_d and tau_J of seven joints.
    """
    fields = ("q", "dq", "q_d", "tau_J")
    names = [f"{field}_{joint}" for field in fields for joint in range(1, 8)]
    columns = {"t": pa.array(rows[:, 0] - origin)}
    for name, values in zip(names, rows[:, 1:].T, strict=True):
        columns[name] = pa.array(values.astype(np.float32))
    return pa.table(columns)


def write_parquet(path: Path, table: pa.Table) -> None:
    """Write `table` to `path` atomically, with the schema's number in the file's metadata."""
    about = {**(table.schema.metadata or {}), "schema": str(SCHEMA)}
    marked = table.replace_schema_metadata(about)
    with replacing(path) as scratch, scratch.open("wb") as file:  # by name it would want UTF-8
        pq.write_table(marked, file, compression="zstd", row_group_size=1 << 20)


def write_tables(folder: Path, tables: Tables) -> None:
    """Write ticks.parquet, profile.parquet and sights.parquet into `folder`."""
    write_parquet(folder / SIGHTS, tables.sights)
    write_parquet(folder / PROFILE, tables.profile)
    write_parquet(folder / TICKS, tables.ticks)


def _numbers(table: pa.Table, column: str) -> Array:
    return np.asarray(table[column].to_numpy(), dtype=np.float64)


def _flatten(column: pa.ChunkedArray) -> pa.Array:
    chunks = [chunk.flatten() for chunk in column.chunks]
    return pa.concat_arrays(chunks) if chunks else pa.array([], pa.float64())
