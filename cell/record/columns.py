"""Streams of a run: what each column holds, in which units and limits, and its checked
arrays.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from itertools import pairwise
from typing import Annotated, Any, NamedTuple, Self, get_type_hints

import numpy as np
import pyarrow as pa

from drivers.base.errors import ConfigurationError
from drivers.base.geometry import interpolate_columns
from drivers.base.types import Array, Pose, frozen

LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}
TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
ANGLES = {"rad": 1.0, "deg": 0.017453292519943295}
FORCES = {"N": 1.0, "mN": 1e-3, "cN": 1e-2}
COUNTS = {"1": 1.0}  # without a unit
FARTHEST_HAND = 5.0  # m, further from the fixed edge nothing of a cell can be
FULL_TURN = 2 * np.pi
# m, further than any camera of a cell sees, however wrong a point may be
FARTHEST_POINT = 100.0
LONGEST_TIME = 1e5  # s, longer than a day
LARGEST_VALUE = 1e9  # nothing of a cell is as large in any unit


class PhysicalQuantity(NamedTuple):
    """What a column of a run's table holds: its allowed units with their factors to SI,
    the SI unit first, and the largest size that is plausible.

    A column that is not `needed` may be missing, one that is `whole` holds no NaN where
    it is.
    """

    units: Mapping[str, float]
    largest: float = LARGEST_VALUE
    needed: bool = True
    whole: bool = True


Time = Annotated[Array, PhysicalQuantity(TIMES, LONGEST_TIME)]
Position = Annotated[Array, PhysicalQuantity(LENGTHS, FARTHEST_HAND)]
Angle = Annotated[Array, PhysicalQuantity(ANGLES, FULL_TURN, needed=False)]
Command = Annotated[Array, PhysicalQuantity(LENGTHS, FARTHEST_HAND, needed=False)]
Turn = Annotated[Array, PhysicalQuantity(ANGLES, FULL_TURN, needed=False, whole=False)]
Closing = Annotated[
    Array, PhysicalQuantity(COUNTS, largest=1.0, needed=False, whole=False)
]
Contact = Annotated[
    Array, PhysicalQuantity(LENGTHS, FARTHEST_HAND, needed=False, whole=False)
]
Duration = Annotated[Array, PhysicalQuantity(TIMES, needed=False, whole=False)]
Force = Annotated[Array, PhysicalQuantity(FORCES, needed=False, whole=False)]
Point = Annotated[Array, PhysicalQuantity(LENGTHS, FARTHEST_POINT)]
Number = Annotated[Array, PhysicalQuantity(COUNTS, np.inf)]
Stamp = Annotated[Array, PhysicalQuantity(TIMES)]
Length = Annotated[Array, PhysicalQuantity(LENGTHS, whole=False)]
Share = Annotated[Array, PhysicalQuantity(COUNTS, whole=False)]


class Columns:
    """Base class of a table of a run: each attribute is one checked column, an array
    with a number for each row.
    """

    __slots__: tuple[str, ...] = ()

    @classmethod
    def none(cls) -> Self:
        """Table without any rows, which has all columns of its class."""
        return cls(**{name: frozen([]) for name in quantities(cls)})

    @classmethod
    def parse(cls, table: pa.Table, origin: str) -> Self:
        """Columns of `table`, checked; ConfigurationError, which names `origin` and the
        column, where one is missing or not plausible.
        """
        return cls(**cls.read(table, origin))

    def table(self) -> pa.Table:
        """The columns as an Arrow table, which other libraries for tables can read as
        well.
        """
        columns = {name: getattr(self, name) for name in self.__slots__}
        rows = max(map(len, columns.values()))
        full = {name: values for name, values in columns.items() if len(values) == rows}
        return pa.table({name: pa.array(values) for name, values in full.items()})

    def frame(self) -> Any:
        """The columns as a data frame where pandas is installed, else as an Arrow
        table.
        """
        return as_frame(self.table())

    def __arrow_c_stream__(self, requested_schema: object = None) -> object:
        return self.table().__arrow_c_stream__(requested_schema)

    @classmethod
    def read(cls, table: pa.Table, origin: str) -> dict[str, Array]:
        """Checked columns of `table` by name, each an array of shape (rows,); one that
        is optional and missing holds NaN.

        Raises ConfigurationError that names `origin` and the column.
        """
        values = {}
        for name, quantity in quantities(cls).items():
            if not quantity.needed and name not in table.column_names:
                values[name] = frozen(np.full(table.num_rows, np.nan))
                continue
            values[name] = _numbers(table, name, origin)
            if quantity.whole:
                _check_finite(values[name], name, origin)
            _check_range(values[name], name, origin, quantity)
        return values


def as_frame(table: pa.Table) -> Any:
    """Data frame with the content of `table` where pandas is installed, else the Arrow
    table itself.
    """
    return table if find_spec("pandas") is None else table.to_pandas()


def quantities(columns: type[Columns]) -> Mapping[str, PhysicalQuantity]:
    """What each column of numbers in the class `columns` holds, by the column's name
    and in the order of the columns.
    """
    hints = get_type_hints(columns, include_extras=True)
    return {
        n: hint.__metadata__[0]
        for n, hint in hints.items()
        if hasattr(hint, "__metadata__")
    }


@dataclass(frozen=True, slots=True)
class Ticks(Columns):
    """Rows of the gripper's motion in a run, as columns of shape (rows,) in s, m, rad
    and N; NaN where something was not measured.

    `hand_cmd` is 1 where the hand was told to close, 0 to open.

    `state` and `image_age` are those of a run of the cell, empty and NaN in others.
    """

    t: Time
    x: Position
    z: Position
    pitch: Angle
    x_cmd: Command
    z_cmd: Command
    contact_x: Contact
    contact_t: Duration
    f_x: Force
    f_z: Force
    image_age: Duration
    pitch_cmd: Turn
    hand_cmd: Closing
    state: tuple[str, ...] = ()

    @classmethod
    def parse(cls, table: pa.Table, origin: str) -> Self:
        """Rows of the gripper's motion from `table`, checked; ConfigurationError names
        `origin` and the column that is wrong.
        """
        values = cls.read(table, origin)
        check_order(values["t"], origin)
        state = (
            table["state"].to_pylist() if table.column_names.count("state") == 1 else []
        )
        return cls(**values, state=tuple(str(name) for name in state))

    def contacts(self) -> tuple[Array, Array]:
        """Times [s] and places along x [m] of the measured points where the strip
        leaves the desk, an array of each.
        """
        seen = np.isfinite(self.contact_x)
        stamps = np.where(np.isfinite(self.contact_t), self.contact_t, self.t)
        return frozen(stamps[seen]), frozen(self.contact_x[seen])

    def pose_at(self, stamp: float) -> Pose:
        """Pose of the gripper at the time `stamp` [s], interpolated between
        the rows.
        """
        poses = np.stack([self.x, self.z, self.pitch], axis=1)
        return Pose.from_array(interpolate_columns(stamp, self.t, poses))


@dataclass(frozen=True, slots=True)
class Profile(Columns):
    """Measured midline points of a run, as columns of shape (points,): the image's time
    `t` [s], the point's number `i` in its image, and `x` and `z` [m].
    """

    t: Time
    i: Number
    x: Point
    z: Point

    @classmethod
    def parse(cls, table: pa.Table, origin: str) -> Self:
        """Points of measured midlines from `table`, checked; ConfigurationError names
        `origin` and the column that is wrong.
        """
        for name in ("x", "z"):
            _check_median(_numbers(table, name, origin), name, origin)
        values = cls.read(table, origin)
        check_order(values["t"], origin, strictly=False)
        return cls(**values)

    def curves(self) -> list[tuple[float, Array]]:
        """Midlines of the strip in order of time, each as a pair of its time [s] and an
        array of points with a row of x and z [m] for each.
        """
        points = np.stack([self.x, self.z], axis=1)
        # rows at which an image begins, and the end: a difference to NaN counts as
        # nonzero
        edges = np.flatnonzero(np.diff(self.t, prepend=np.nan, append=np.nan))
        return [
            (
                float(self.t[start]),
                points[start:end][np.argsort(self.i[start:end], kind="stable")],
            )
            for start, end in pairwise(edges)
        ]


@dataclass(frozen=True, slots=True)
class Sights(Columns):
    """What was measured of the strip in each image of a run, as columns of shape
    (images,) in SI units.
    """

    stamp: Stamp
    sequence: Annotated[Array, PhysicalQuantity(COUNTS)]
    contact_x: Length
    contact_confidence: Share
    profile_confidence: Share
    tip_x: Length
    tip_z: Length
    gap: Length
    gap_x: Length


def _numbers(table: pa.Table, name: str, origin: str) -> Array:
    """Column `name` of `table` as an array of numbers; ConfigurationError, which names
    `origin`, where it is missing or holds no numbers.
    """
    if name not in table.column_names:
        raise ConfigurationError(f"{origin}: {name}: the column is missing; add it")
    if table.column_names.count(name) > 1:
        raise ConfigurationError(
            f"{origin}: {name}: there are two such columns; keep one"
        )

    column = table[name]
    if not (pa.types.is_floating(column.type) or pa.types.is_integer(column.type)):
        raise ConfigurationError(
            f"{origin}: {name}: holds {column.type}, must hold numbers"
        )

    try:
        return frozen(column.cast(pa.float64(), safe=False).to_numpy())
    except pa.ArrowException as error:
        raise ConfigurationError(f"{origin}: {name}: cannot be read: {error}") from None


def _check_finite(values: Array, name: str, origin: str) -> None:
    """Raise ConfigurationError where one of `values` in the column `name` is infinite
    or NaN.
    """
    wrong = np.flatnonzero(~np.isfinite(values))
    if wrong.size:
        raise ConfigurationError(
            f"{origin}: {name}: row {wrong[0]} is {values[wrong[0]]}, must be a finite"
            " number; leave rows out that were not measured"
        )


def check_order(t: Array, origin: str, strictly: bool = True) -> None:
    """Raise ConfigurationError where successive times `t` [s], an array of shape
    (rows,), decrease or, if `strictly`, where two of them are equal.
    """
    steps = np.diff(t)
    wrong = np.flatnonzero(steps <= 0 if strictly else steps < 0)
    if not wrong.size:
        return

    before = int(wrong[0])
    row = before + 1
    step = np.median(np.abs(steps))
    earlier, later = t[before : row + 1]
    uneven = np.diff(np.sort(t)).min() < 0.5 * step
    remedy = "sort the rows"
    if later == earlier:
        remedy = "keep one row for each time"
    elif was_set_back(t) or (uneven and wrong.size < 0.1 * t.size):
        back = earlier + step - later
        remedy = f"the clock was set back by {back:.3g} s: cut the run there"

    raise ConfigurationError(
        f"{origin}: t: row {row} is {later:g} s after {earlier:g} s, times must"
        f" increase; {remedy}"
    )


def was_set_back(t: Array) -> bool:
    """Whether the times `t` of rows, of shape (rows,), show that their clock was set
    back, so that sorting the rows would mix different moments.

    Sorting is right where rows or whole pieces only changed places: then few that lay
    apart become neighbours.
    """
    order = np.argsort(t, kind="stable")
    woven = int((np.abs(np.diff(order)) > 1).sum())
    return woven > 4 * int((np.diff(t) < 0).sum())


def _check_median(values: Array, name: str, origin: str) -> None:
    """Raise ConfigurationError where the median size of `values`, lengths of the column
    `name`, is so large that their unit must be wrong.
    """
    middle = np.median(np.abs(values)) if values.size else 0.0
    if middle > FARTHEST_HAND:
        raise ConfigurationError(
            f"{origin}: {name}: is {middle:.3g} in the middle, must stay within "
            f"{FARTHEST_HAND:g} m; give it in m"
        )


def _check_range(
    values: Array, name: str, origin: str, quantity: PhysicalQuantity
) -> None:
    """Raise ConfigurationError where one of `values` in the column `name` is larger
    than its `quantity` can be.
    """
    largest = np.max(np.abs(values[~np.isnan(values)]), initial=0.0)
    unit = next(iter(quantity.units))
    if largest > quantity.largest:
        raise ConfigurationError(
            f"{origin}: {name}: reaches {largest:.6g}, must stay within"
            f" {quantity.largest:.3g} {unit}; give it in {unit}"
        )
