"""Streams of rows written during a run, and the Parquet tables made from them at its
end.

A stream (Arrow IPC) has one row per message: rows written before a crash can be read
after it.
"""

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray
from pyarrow.csv import ConvertOptions

from cell.record.columns import Sights, Ticks, quantities
from cell.record.events import lift_time
from cell.record.files import PROFILE, SIGHT_STREAM, SIGHTS, TICK_STREAM, TICKS
from drivers.base.errors import ConfigurationError, suggestion
from drivers.base.files import new_file, replacing, write_all
from drivers.base.readers import MEGABYTE, SCHEMA, read_bytes
from drivers.base.types import Array, frozen
from drivers.franka.joint_log import JOINT_FIELDS

TIME_ROUNDING = 1e-9  # s
# s, no image or touch is so long before the first or after the last row
TIME_MARGIN = 1.0
END_OF_STREAM = b"\xff\xff\xff\xff\x00\x00\x00\x00"
LARGEST_STREAM = 128 * MEGABYTE  # a fold of two minutes writes ten
MOST_COLUMNS = 4096
NAMED = 30  # columns of a table that a refusal lists
NUMBER = pa.float64()
EMPTY = {*ConvertOptions().null_values, "None", "#NV", "#DIV/0!", "#VALUE!"}  # no value
QUANTITY = re.compile(r"\s*([-+]?\d*\.?\d+(?:[eE][-+]?\d+)?)\s*([^\W\d_]\D*?|%|°)\s*")
# 31.01.2026 12:00:00,250 as ISO 8601
AS_ISO = ((r"^(\d\d)[.](\d\d)[.](\d{4})\b", r"\3-\2-\1"), (r"(:\d\d),(\d+)", r"\1.\2"))
# of a part in a list: name.0, name0, joint_names[0]
NAME_IN_LIST = re.compile(r"(.*?)(?:joint_?)?names?((?:\.|\[)?\d+\]?)")
Labels = Mapping[str, tuple[str, pa.ChunkedArray]]
"""Names of the parts at each place of a list, `.0`, with what stands before `name`."""
DOUBLED = re.compile(r"(.+) \(([1-9]\d?)\)")  # the second of two columns: `q (2)`
POINTS_TYPE = pa.list_(NUMBER)

LATER = {"pitch_cmd", "hand_cmd"}  # columns of ticks that older runs lack
PLACED = ("contact_x", "contact_t")  # columns of ticks that come from the images
TICK_ROWS = pa.schema(
    [(name, NUMBER) for name in quantities(Ticks) if name not in PLACED]
    + [("state", pa.string())]
)
SIGHT_ROWS = pa.schema(
    [
        (name, pa.int64() if name == "sequence" else NUMBER)
        for name in quantities(Sights)
    ]
    + [("profile_x", POINTS_TYPE), ("profile_z", POINTS_TYPE)]
)


class TooLarge(ConfigurationError):
    """Error for a table with more columns or values than this program reads, whatever a
    mapping says of it.
    """


class StreamFile:
    """Writer of a table to an Arrow stream file, row by row, so that no row is lost
    where the process dies.
    """

    def __init__(self, path: Path, schema: pa.Schema) -> None:
        self._row = pa.struct(list(schema))
        self._file = new_file(path)
        self._write(schema.serialize())

    def append(self, row: Mapping[str, Any]) -> None:
        """Write one more row, with a value for each column in `row`; OSError where that
        fails.
        """
        rows = pa.array([row], self._row)
        self._write(pa.RecordBatch.from_struct_array(rows).serialize())

    def close(self) -> None:
        """Close the file of the stream; a second call does nothing."""
        if not self._file.closed:
            try:
                self._write(END_OF_STREAM)
            finally:
                self._file.close()

    def _write(self, content: Any) -> None:
        write_all(self._file, memoryview(content))


def _read_stream(path: Path, schema: pa.Schema) -> pa.Table:
    """All whole rows of the Arrow stream file at `path`, as a table with the columns of
    `schema`.

    Empty without a file, or with one truncated inside its header. Raises
    ConfigurationError for a stream without these columns.
    """
    batches: list[pa.RecordBatch] = []
    stored = schema
    content = read_bytes(path, LARGEST_STREAM) if path.exists() else b""

    # the end, or the first broken row
    with suppress(StopIteration, pa.ArrowException, OSError):
        reader = pa.ipc.open_stream(pa.py_buffer(content))
        stored = reader.schema
        while True:
            batch = reader.read_next_batch()
            batch.validate(full=True)
            batches.append(batch)

    rows = pa.Table.from_batches(batches, stored)
    for name in LATER - {*rows.column_names}:
        rows = rows.append_column(name, pa.nulls(len(rows), NUMBER))

    try:
        rows = rows.select(schema.names)
        return rows.cast(schema).combine_chunks()
    except (KeyError, ValueError, pa.ArrowException) as error:
        raise ConfigurationError(
            f"{path}: {error}; it was changed after the run"
        ) from None


Tables = dict[str, pa.Table]
"""Tables of a run by their files: sights (a row per image), profile (points of
midlines), ticks.
"""


def assemble(folder: Path) -> Tables:
    """Tables of the run in `folder` by file name, made from its stream files, which may
    be cut off.

    Raises ConfigurationError for a stream that is broken or was changed after the run.
    """
    begin = lift_time(folder)
    ticks = _from_time(begin, _read_stream(folder / TICK_STREAM, TICK_ROWS), "t")
    sights = _from_time(begin, _read_stream(folder / SIGHT_STREAM, SIGHT_ROWS), "stamp")
    _check_profiles(sights, folder / SIGHT_STREAM)
    # readers of the tables refuse values that are not finite
    with np.errstate(all="ignore"):
        return sight_tables(sights) | {TICKS: _tick_table(ticks, sights)}


def _check_profiles(sights: pa.Table, path: Path) -> None:
    """Raise ConfigurationError where a row of `sights` has no midline, or one with
    unequal numbers of x and z.
    """
    x, z = (pc.list_value_length(sights[name]) for name in ("profile_x", "profile_z"))
    if x.null_count or z.null_count or not x.equals(z):
        raise ConfigurationError(
            f"{path}: rows do not fit each other: a profile has no or unequal"
            " coordinates; it was changed after the run"
        )


def _from_time(begin: float, rows: pa.Table, time: str) -> pa.Table:
    """Rows of a table from the time `begin` [s] on, whose column `time` counts from
    there; all rows where `begin` is 0.
    """
    if begin == 0.0:
        return rows
    t = _numbers(rows, time) - begin
    is_after = t >= -TIME_ROUNDING
    rows = rows.filter(pa.array(is_after))
    column = rows.column_names.index(time)
    return rows.set_column(column, time, pa.array(t[is_after]))


def _tick_table(ticks: pa.Table, sights: pa.Table) -> pa.Table:
    """Table of the gripper's motion, in which each measured desk contact stands in the
    row that is nearest in time to its image.

    A row whose stamp did not advance contains no new measurement and is left out, and
    so is one of an arm that reported no number, which no reader takes.
    """
    t = _numbers(ticks, "t")
    # stamp before each row
    latest = np.maximum.accumulate(np.concatenate([[-np.inf], t]))[:-1]
    finite = np.isfinite([_numbers(ticks, name) for name in ("x", "z", "pitch")]).all(
        axis=0
    )
    ticks = ticks.filter(pa.array((t > latest) & finite))
    t = _numbers(ticks, "t")
    contacts = place_contacts(
        t, _numbers(sights, "stamp"), _numbers(sights, "contact_x")
    )
    placed = dict(zip(PLACED, contacts, strict=True))
    return pa.table(
        {n: placed[n] if n in placed else ticks[n] for n in Ticks.__slots__}
    )


def check_clock(
    stamps: Array, t: Array, origin: str, before: float = TIME_MARGIN
) -> None:
    """Raise ConfigurationError where some of `stamps` [s], of shape (readings,), lie
    outside the times `t` [s] of the gripper's motion.

    They may lie less than `before` [s] before the first row, and TIME_MARGIN after the
    last one.
    """
    if not t.size:
        return
    early, late = (
        float(np.nanmax(by, initial=-np.inf)) for by in (t[0] - stamps, stamps - t[-1])
    )
    if early >= before or late > TIME_MARGIN:
        where = (
            "before the gripper's first" if early > late else "after the gripper's last"
        )
        raise ConfigurationError(
            f"{origin}: is {max(early, late):.6g} s {where} row; give all times of a"
            " run in s on one clock"
        )


def place_contacts(t: Array, stamp: Array, contact_x: Array) -> tuple[Array, Array]:
    """Columns with desk contacts [m] and their times [s], of the same shape as the
    times `t` [s], with each contact in the row nearest in time.

    NaN without an image; of two nearest to one row the nearer is used; others are
    dropped.
    """
    placed_x, placed_t = np.full((2, t.size), np.nan)
    if t.size < 2:
        return placed_x, placed_t

    reach = 0.5 * np.median(np.diff(t))
    keep = np.isfinite(contact_x) & (stamp >= t[0] - reach) & (stamp <= t[-1] + reach)
    stamp = stamp[keep]
    contact_x = contact_x[keep]
    row = place_rows(t, stamp)
    nearest_last = np.argsort(-np.abs(t[row] - stamp), kind="stable")
    # the last assignment to a row stays
    placed_x[row[nearest_last]] = contact_x[nearest_last]
    placed_t[row[nearest_last]] = stamp[nearest_last]
    return placed_x, placed_t


def place_rows(t: Array, stamps: Array) -> NDArray[np.intp]:
    """Numbers of the rows, of the same shape as `stamps`, whose increasing times `t`
    are nearest to `stamps`; there are at least two rows.
    """
    after = np.clip(np.searchsorted(t, stamps), 1, t.size - 1)
    nearer = stamps - t[after - 1] <= t[after] - stamps
    rows: NDArray[np.intp] = np.where(nearer, after - 1, after)
    return rows


def sight_tables(sights: pa.Table) -> Tables:
    """Two tables by file name: the measurements `sights` of the strip without midlines,
    and the points of all midlines.
    """
    counts = pc.list_value_length(sights["profile_x"]).to_numpy()
    points = {
        "t": np.repeat(_numbers(sights, "stamp"), counts),
        "i": pa.array([i for count in counts for i in range(count)], pa.int64()),
        "x": sights["profile_x"].combine_chunks().flatten(),
        "z": sights["profile_z"].combine_chunks().flatten(),
    }
    return {
        SIGHTS: sights.drop_columns(["profile_x", "profile_z"]),
        PROFILE: pa.table(points),
    }


def joint_table(rows: Array, origin: float) -> pa.Table:
    """Table of a robot's joints from `rows` of shape (n, 29), with times that count
    from `origin` [s].

    A row holds the time [s] on the cell's clock, then q, dq, q_d and tau_J of seven
    joints.
    """
    names = [f"{field}_{joint}" for field in JOINT_FIELDS for joint in range(1, 8)]
    joints = zip(names, rows[:, 1:].T.astype(np.float32), strict=True)
    return pa.table({"t": rows[:, 0] - origin} | dict(joints))


def write_parquet(path: Path, table: pa.Table) -> None:
    """Write `table` as a Parquet file to `path`, where it replaces an older file only
    once it is complete.

    The table's metadata get as `schema` the version of the cell's files. Bytes of like
    weight stand together, which makes measured numbers a third smaller.
    """
    about = {**(table.schema.metadata or {}), "schema": str(SCHEMA)}
    marked = table.replace_schema_metadata(about)
    # an open file, as the library takes only names in UTF-8 and a folder's may be in
    # any bytes
    with replacing(path) as scratch, scratch.open("wb") as file:
        pq.write_table(
            marked,
            file,
            compression="zstd",
            row_group_size=1 << 20,
            use_dictionary=[f.name for f in table.schema if f.type != NUMBER],
            use_byte_stream_split=[f.name for f in table.schema if f.type == NUMBER],
        )


def write_tables(folder: Path, tables: Tables) -> None:
    """Write each of `tables`, given by file name, into the run folder `folder`."""
    for name, table in tables.items():
        write_parquet(folder / name, table)


def _numbers(table: pa.Table, column: str) -> Array:
    numbers: Array = table[column].to_numpy()
    return numbers


def unnest(
    table: pa.Table, origin: str, names: Mapping[str, object] | None = None
) -> pa.Table:
    """Copy of a table in which fields of records and numbers of vectors have columns of
    their own, such as `pose.x` and `q.0`.

    `names` are those of the numbers of a vector, by its column, as a LeRobot data set
    states them. Raises ConfigurationError, with the `origin` of the table, for too many
    columns.
    """
    found: list[tuple[str, pa.ChunkedArray]] = []
    while any(map(pa.types.is_struct, table.schema.types)):
        table = table.flatten()
    for name, column in zip(table.column_names, table.columns, strict=True):
        stated = (names or {}).get(name)
        parts = _parts_of(column, stated, f"{origin}: column {name!r}")
        named = [
            (name if axis is None else f"{name}.{axis}", part)
            for axis, part in parts.items()
        ]
        if named and pa.types.is_nested(column.type):
            inner = unnest(pa.table(dict(named)), origin)
            named = [*zip(inner.column_names, inner.columns, strict=True)]
        found += named or [(name, column)]
        check_width(len(found), origin)
    return pa.table([column for _, column in found], [name for name, _ in found])


def _parts_of(
    column: pa.ChunkedArray, stated: object, origin: str
) -> dict[Any, pa.ChunkedArray]:
    """Columns of the single numbers of a vector, by the names that are `stated` for
    them; empty for lists of unequal lengths.
    """
    kind = column.type
    if not (pa.types.is_list(kind) or pa.types.is_fixed_size_list(kind)):
        return dict.fromkeys(_axes(stated, size=1), column)

    sizes = pc.list_value_length(column).unique().to_pylist()
    size = (sizes[0] or 0) if len(sizes) == 1 else 0
    check_width(size, origin)
    axes = _axes(stated, size)
    return {axis: pc.list_element(column, i) for i, axis in enumerate(axes)}


def check_width(count: int, origin: str) -> None:
    """Raise TooLarge where a table or a list has so many columns, `count`, that this
    program does not read it.
    """
    if count > MOST_COLUMNS:
        raise TooLarge(
            f"{origin}: holds {count} columns, at most {MOST_COLUMNS} are read; leave"
            " images and point clouds out"
        )


def _axes(stated: object, size: int) -> Sequence[object]:
    """Names of the `size` numbers of a feature: as they are `stated`, or else counted
    from 0, or None for a single number.
    """
    if isinstance(stated, dict):
        kinds = list(stated.values())
        stated = (
            kinds[0] if len(kinds) == 1 and isinstance(kinds[0], list) else list(stated)
        )
    if isinstance(stated, list) and len(stated) == size:
        return [*map(str, stated)]
    return [None] if size == 1 else range(size)


def with_named_parts(
    content: pa.Table, columns: Sequence[str], origin: str
) -> pa.Table:
    """Copy of a table with a further column for each of `columns` that names a part of
    a list, such as `position.elbow`.

    Each row lists the names of its parts, `name.0` and so on, in any order; rows
    without any of these parts are left out. Raises ConfigurationError for a part by its
    place, `position.0`, where its name changes.
    """
    labels: dict[str, tuple[str, pa.ChunkedArray]] = {}
    for name, values in zip(content.column_names, content.columns, strict=True):
        found = NAME_IN_LIST.fullmatch(name)
        if found and pa.types.is_string(values.type):
            labels[found[2]] = found[1], values

    picked: list[pa.ChunkedArray] = []
    for column in columns:
        if column in content.column_names:
            _check_index(column, labels, f"{origin}: column {column!r}")
        elif parts := _parts_named(column, labels, content):
            picked.append(pc.coalesce(*parts))
            content = content.append_column(column, picked[-1])

    if not picked:
        return content
    return content.filter(reduce(pc.or_, map(pc.is_valid, picked)))


def _parts_named(column: str, labels: Labels, content: pa.Table) -> list[pa.Array]:
    """Values of the part of a list that `column` names, one array for each place in the
    list, empty where another part stands there.
    """
    parts: list[pa.Array] = []
    for index, (_, label) in labels.items():
        for name in filter(None, pc.unique(label).to_pylist()):
            value = f"{column.removesuffix(f'.{name}')}{index}"
            if column.endswith(f".{name}") and value in content.column_names:
                is_there = pc.fill_null(pc.equal(label, name), False)
                parts.append(pc.if_else(is_there, content[value], None))
    return parts


def _check_index(column: str, labels: Labels, origin: str) -> None:
    """Raise ConfigurationError where `column` asks for a place in a list at which
    different rows hold parts of different names.
    """
    for index, (prefix, label) in labels.items():
        names = pc.unique(label).drop_null().to_pylist()
        in_list = rf"{re.escape(prefix)}[^.]*[^.\d\[]{re.escape(index)}"
        if len(names) > 1 and re.fullmatch(in_list, column):
            field = column.removesuffix(index)
            raise ConfigurationError(
                f"{origin}: is {names[0]}, later {names[1]}; choose parts by their"
                f" names: {field}.{names[0]}"
            )


def turn_of(x: Array, y: Array, z: Array, w: Array) -> Array:
    """Angles [rad], of the same shape as `x`, by which a body has turned from x towards
    z since the first of the quaternions with the parts `x`, `y`, `z`, `w`.
    """
    along = w * w[:1] + x * x[:1] + y * y[:1] + z * z[:1]
    across = w * y[:1] - y * w[:1] + z * x[:1] - x * z[:1]
    turn: Array = 2 * np.unwrap(np.arctan2(across, along), period=np.pi)
    return turn


def numbers_of(raw: pa.ChunkedArray) -> Array | None:
    """Numbers of a column, of shape (rows,), with NaN for an empty cell; None for a
    column that holds anything else.
    """
    kind = raw.type  # null where every cell is empty
    if (told := unit_in_cells(raw)) is not None:
        cells = (cell.replace(told, "") for cell in raw.to_pylist())
        return np.array([np.nan if cell in EMPTY else float(cell) for cell in cells])
    types = pa.types
    if not (types.is_floating(kind) or types.is_integer(kind) or types.is_null(kind)):
        return None
    numbers: Array = raw.cast(NUMBER, safe=False).to_numpy()
    return numbers


def unit_in_cells(raw: pa.ChunkedArray) -> str | None:
    """Unit that all cells of a column of text state, such as `sec` in `0.004 sec`; None
    where they do not state the same one.
    """
    if not pa.types.is_string(raw.type):
        return None
    cells = (cell for cell in raw.to_pylist() if cell not in EMPTY)
    units = {found and found[2] for found in map(QUANTITY.fullmatch, cells)}
    return units.pop() if len(units) == 1 else None


def seconds_of(raw: pa.ChunkedArray) -> Array | None:
    """Seconds since 1970, of shape (rows,), of the ISO 8601 times in a column; None for
    a column that holds anything else.
    """
    is_text = pa.types.is_string(raw.type)
    if not (is_text or pa.types.is_timestamp(raw.type)):
        return None
    for pattern, iso in AS_ISO if is_text else ():
        raw = pc.replace_substring_regex(raw, pattern, iso)
    for kind in (pa.timestamp("ns"), pa.timestamp("ns", "UTC")):
        with suppress(pa.ArrowException):
            return frozen(raw.cast(kind).cast(pa.int64()).to_numpy() / 1e9)
    return None


def column_named(content: pa.Table, name: str, origin: str) -> pa.ChunkedArray:
    """Column called `name` of the table `content`; ConfigurationError, which names
    `origin`, where there is none or more than one.
    """
    names = content.column_names
    indices = [index for index, each in enumerate(names) if each == name]
    if not indices:  # of a heading of several rows the last one may do
        indices = [i for i, each in enumerate(names) if each.endswith(f" {name}")]

    if (doubled := DOUBLED.fullmatch(name)) and not indices:
        first = doubled[1]
        number = int(doubled[2])
        indices = [index for index, each in enumerate(names) if each == first]
        indices = indices[number - 1 : number]

    if len(indices) != 1:
        there = f"is not there{suggestion(name, names)}"
        if indices:
            times = f"stands there {len(indices)} times"
            there = f"{times}; write {name!r} with ' (1)' or the like"
        more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
        raise ConfigurationError(
            f"{origin} {there}; columns: {', '.join(names[:NAMED])}{more}"
        )
    return content.column(indices[0])
