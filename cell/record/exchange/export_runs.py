"""Export of recorded runs to the formats of other programs."""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import pyarrow as pa
import pyarrow.csv as pc

from cell.extras import require_library
from cell.record.documents import write_document
from cell.record.exchange.mapping import MAPPING
from cell.record.exchange.run_tables import RunTables, check_alike, mapping_of
from cell.record.run import read_run
from drivers.errors import ConfigurationError
from drivers.files import check_free, new_folder, replace_file

Format = Literal["csv", "lerobot", "mcap"]


def export_runs(folders: Sequence[Path], kind: Format, out: Path) -> tuple[Path, ...]:
    """Write the runs in `folders` into the new folder `out`; returns the files or folders.

    All is written, or nothing. Raises ConfigurationError for runs that cannot be read or do not go
    together, an `out` that is there already, or a library that is missing.
    """
    check_free(out)
    if kind == "mcap":
        require_library("mcap")
    parts = [RunTables.of(read_run(folder)) for folder in folders]
    names = [part.run.name for part in parts]
    if len(set(names)) < len(names):
        raise ConfigurationError(f"two runs are named {max(names, key=names.count)}; rename one")
    with new_folder(out) as made:
        paths = _write(parts, kind, made)
    return tuple(out / path.relative_to(made) for path in paths)


def _write(parts: Sequence[RunTables], kind: Format, out: Path) -> tuple[Path, ...]:
    if kind == "mcap":
        from cell.record.exchange.mcap_file import write_mcap

        return write_mcap(parts, out)
    if kind == "lerobot":
        from cell.record.exchange.lerobot import write_lerobot

        return write_lerobot(parts, out)
    check_alike([part.run for part in parts])
    for part in parts:  # a folder of tables each, and one mapping for all
        (out / part.run.name).mkdir(parents=True)
        for name, columns in part.tables.items():
            sink = pa.BufferOutputStream()
            pc.write_csv(pa.table(dict(columns)), sink)
            replace_file(out / part.run.name / f"{name}.csv", sink.getvalue().to_pybytes())
    names = mapping_of(parts, lambda table, column: (f"{table}.csv", column))
    write_document(out / MAPPING, names)
    return tuple(out / part.run.name for part in parts)
