"""Converts tables of other programs to runs of a mechanism, by a mapping of their columns."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
from pydantic import Field

from cell.gap.subject.run_folders import read_table
from drivers.errors import ConfigurationError
from drivers.files import write_file
from drivers.settings import Settings, load
from drivers.types import Array
from drivers.yaml_text import dump_yaml


class ColumnSpec(Settings):
    """Source of a value: a `column` of the table, of which value = factor * column + offset."""

    column: str
    factor: float = 1.0
    offset: float = 0.0


class ColumnMap(Settings):
    """Content of a mapping file: the source of the time, and of each signal or input by name."""

    schema_: int = Field(1, alias="schema")
    t: ColumnSpec
    columns: dict[str, ColumnSpec] = Field(min_length=1)


def import_table(table: Path, mapping: Path, out: Path, head: Mapping[str, Any]) -> None:
    """Write a CSV or Parquet `table` as the run folder `out`, with `head` in its run.yaml.

    Raises ConfigurationError for a table or a mapping that is broken.
    """
    spec = load(mapping, ColumnMap)
    found = _columns(table)
    names = {"t": spec.t, **spec.columns}
    missing = next((c.column for c in names.values() if c.column not in found), None)
    if missing is not None:
        raise ConfigurationError(
            f"{table}: {missing}: no such column; {mapping} names it, there are {', '.join(found)}"
        )
    write_run(out, {n: c.factor * found[c.column] + c.offset for n, c in names.items()}, head)


def _columns(table: Path) -> dict[str, Array]:
    if table.suffix == ".parquet":
        return read_table(table)
    try:
        read = pyarrow.csv.read_csv(table)
    except (OSError, pa.ArrowInvalid) as error:
        reason = " ".join(str(error).split())[:120]
        raise ConfigurationError(f"{table}: is no CSV with a header line: {reason}") from None
    numbers = (pa.types.is_floating, pa.types.is_integer)
    kept = [n for n in read.column_names if any(is_(read[n].type) for is_ in numbers)]
    return {n: np.array(read[n].to_numpy(), dtype=np.float64) for n in kept}


def write_run(out: Path, columns: Mapping[str, Array], head: Mapping[str, Any]) -> None:
    """Write a run folder `out` with columns (m,) by name and the header `head`."""
    out.mkdir(parents=True, exist_ok=True)
    pq.write_table(
        pa.table({n: np.asarray(v) for n, v in columns.items()}), out / "signals.parquet"
    )
    write_file(out / "run.yaml", dump_yaml({"schema": 1, **head}))
