"""The mapping file of `cell import`: the foreign column for each quantity, with its unit."""

from typing import Annotated, Literal

from pydantic import Field

from cell.record.header import Sigma
from drivers.settings import Metres, Seconds, Settings

LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}
TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
ANGLES = {"rad": 1.0, "deg": 0.017453292519943295}
FORCES = {"N": 1.0, "mN": 1e-3, "cN": 1e-2}
FACTORS = LENGTHS | TIMES | ANGLES | FORCES
MEASURES = {
    "t": TIMES, "contact_t": TIMES, "t_layer_touch": TIMES, "pitch": ANGLES,
    "f_x": FORCES, "f_z": FORCES,
}  # fmt: skip
"""Units by column; all other columns are lengths."""
COUNTS = frozenset({"i"})  # have no unit
MAPPING = "mapping.yaml"  # as `cell export` names it

Delimiter = Annotated[str, Field(min_length=1, max_length=1)]
TickColumn = Literal["t", "x", "z", "pitch", "x_cmd", "z_cmd", "contact_x", "contact_t",
                     "f_x", "f_z"]  # fmt: skip
ResultColumn = Literal["t_layer_touch", "l1", "l2", "displacement"]


class Column(Settings):
    """A foreign column: name, unit, `offset` [SI] of its zero; if `reversed`, the sign changes."""

    column: str = Field(min_length=1)
    unit: str
    offset: float = 0.0
    reversed: bool = False


class Table(Settings):
    """Place of a table: a file in the run's folder, a topic of an MCAP file, or `episode`.

    Files are CSV or Parquet, `episode` is that of a LeRobot data set. `late` [s] is the delay of
    the table's stamps.
    """

    file: str = Field(min_length=1)
    delimiter: Delimiter = ","
    decimal: Literal[".", ","] = "."
    late: Seconds = Field(0.0, ge=-10.0, le=10.0)


class TickTable(Table):
    """Table of the gripper's motion, one row per tick; at least `t`, `x`, `z`."""

    columns: dict[TickColumn, Column]


class ProfileTable(Table):
    """Table of points of the strip's midline, one per row; `t` is equal within an image."""

    columns: dict[Literal["t", "i", "x", "z"], Column]


class ContactTable(Table):
    """Table of the strip's contact with the desk, one row per image."""

    columns: dict[Literal["t", "contact_x"], Column]


class ResultTable(Table):
    """Table with the touch of the layers in one row; absent where none was seen."""

    columns: dict[ResultColumn, Column]


class Place(Settings):
    """Order of a run in its series, `index`, and the `condition` that its repeats share."""

    index: int | None = Field(None, ge=0, le=1_000_000)
    condition: str | None = None


class Mapping(Settings):
    """Contents of a mapping file; quantities left out were not measured.

    `sigma` are the one-sigma errors [m], [s], [N] of what was measured; `runs` are facts of single
    runs by the name of their folder, without which their order is that of the call;
    `begin` is their clock at our t = 0, without it that of the first row of `ticks`;
    `seen_by` says that this cell's perception saw the strip, whose errors are known.
    """

    schema_: Literal[1] = Field(1, alias="schema")
    strip: str = Field(min_length=1)
    start: Literal["flat", "hanging"] = "flat"
    condition: str | None = None
    begin: Seconds | None = None
    contact_height: Metres = Field(0.001, gt=0, le=0.05)
    seen_by: Literal["cell"] | None = None
    runs: dict[str, Place] = Field(default_factory=dict)
    sigma: Sigma
    ticks: TickTable
    profile: ProfileTable | None = None
    contact: ContactTable | None = None
    result: ResultTable | None = None
