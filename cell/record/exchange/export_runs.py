"""Export of recorded runs to the formats of other programs."""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import pyarrow as pa
import pyarrow.csv as pc

from cell.record.exchange.mapping import MAPPING, mapping_of
from cell.record.files import runs_in
from cell.record.run import Run, read_run
from drivers.base.errors import ConfigurationError
from drivers.base.extras import require_library
from drivers.base.files import check_free, new_folder, replace_file

Format = Literal["csv", "lerobot", "mcap"]


def export_runs(folders: Sequence[Path], kind: Format, out: Path) -> tuple[Path, ...]:
    """Write the runs at or in `folders` in the format `kind` into the new folder `out`,
    and return the paths of the files or folders made.

    All is written, or nothing. Raises ConfigurationError for runs that cannot be read
    or do not go together, an `out` that is there already, or a library that is missing.
    """
    check_free(out)
    if kind == "mcap":
        require_library("mcap")
    runs = [read_run(run) for folder in folders for run in runs_in(folder) or [folder]]
    for run in runs:
        if not len(run.ticks.t):
            raise ConfigurationError(f"{run.folder}: holds no row; leave it out")
    names = [run.name for run in runs]
    if len(set(names)) < len(names):
        raise ConfigurationError(
            f"two runs are named {max(names, key=names.count)}; rename one"
        )
    with new_folder(out) as made:
        paths = _write(runs, kind, made)
    return tuple(out / path.relative_to(made) for path in paths)


def _write(runs: Sequence[Run], kind: Format, out: Path) -> tuple[Path, ...]:
    """Write `runs` in the format `kind` into the folder `out`, and return the paths of
    the files or folders made.
    """
    if kind == "mcap":
        from cell.record.exchange.mcap_file import write_mcap

        return write_mcap(runs, out)
    if kind == "lerobot":
        from cell.record.exchange.lerobot import write_lerobot

        return write_lerobot(runs, out)
    for run in runs:  # a folder of tables each, and one mapping for all
        alike = ("strip", "start", "sigma", "contact_height")
        if any(getattr(run.header, k) != getattr(runs[0].header, k) for k in alike):
            raise ConfigurationError(
                f"{run.folder}: differs from {runs[0].folder} in strip, start or sigma;"
                " export runs of one kind together, or as lerobot or mcap"
            )
        (out / run.name).mkdir(parents=True)
        for name, columns in run.tables().items():
            sink = pa.BufferOutputStream()
            pc.write_csv(pa.table(dict(columns)), sink)
            replace_file(out / run.name / f"{name}.csv", sink.getvalue().to_pybytes())
    mapping = mapping_of(runs, lambda table, column: (f"{table}.csv", column))
    replace_file(out / MAPPING, mapping)
    return tuple(out / run.name for run in runs)
