"""Runs as folders of CSV tables, beside one mapping file for all."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import pyarrow as pa
import pyarrow.csv as pc

from cell.record.documents import write_document
from cell.record.exchange.mapping import MAPPING
from cell.record.exchange.outgoing import Outgoing, mapping_of
from drivers.files import replace_file
from drivers.types import Array


def write_csv(parts: Sequence[Outgoing], out: Path) -> tuple[Path, ...]:
    """A folder of tables for each run in the new folder `out`, and one mapping for all."""
    for part in parts:
        (out / part.run.name).mkdir(parents=True)
        for name, columns in part.tables.items():
            _write(out / part.run.name / f"{name}.csv", columns)
    names = mapping_of(parts, lambda table, column: (f"{table}.csv", column))
    write_document(out / MAPPING, names)
    return tuple(out / part.run.name for part in parts)


def _write(path: Path, columns: Mapping[str, Array]) -> None:
    sink = pa.BufferOutputStream()
    pc.write_csv(pa.table({name: pa.array(values) for name, values in columns.items()}), sink)
    replace_file(path, sink.getvalue().to_pybytes())
