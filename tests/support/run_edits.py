"""Edits of the files of a run folder."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import yaml

from cell.gap.subject.run_table import read_table
from drivers.base.types import Array


def edit_yaml(path: Path, **changes: object) -> None:
    """Set some keys of a YAML file to other values, and take those of None out."""
    content = yaml.safe_load(path.read_text()) | changes
    kept = {key: value for key, value in content.items() if value is not None}
    path.write_text(yaml.safe_dump(kept))


def edit_column(path: Path, name: str, change: Callable[[Array], Array]) -> None:
    """Replace one column (m,) of a Parquet file by `change` of it."""
    table = pq.read_table(path)
    values = pa.array(change(table[name].to_numpy().astype(np.float64)))
    pq.write_table(table.set_column(table.column_names.index(name), name, values), path)


def edit_table(path: Path, change: Callable[[dict[str, Array]], object]) -> None:
    """Change the columns (m,) of a Parquet file, by name, in place."""
    columns = read_table(path)
    change(columns)
    pq.write_table(pa.table(columns), path)


def put(row: int, value: float) -> Callable[[Array], Array]:
    """Function that sets one row of a column (m,) to `value`."""

    def change(values: Array) -> Array:
        values[row] = value
        return values

    return change
