"""Export of recorded runs to the formats of other programs."""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from cell.extras import require_library
from cell.record.exchange.outgoing import outgoing
from cell.record.run import read_run
from drivers.errors import ConfigurationError
from drivers.files import writing

Format = Literal["csv", "lerobot", "mcap"]


def export_runs(folders: Sequence[Path], kind: Format, out: Path) -> tuple[Path, ...]:
    """The files or folders in the new folder `out` that hold the runs in `folders`.

    Raises ConfigurationError for runs that cannot be read or do not go together, an `out` that is
    there already, or a library that is missing.
    """
    if out.exists():
        raise ConfigurationError(f"{out}: is there already; name another folder")
    if kind == "mcap":
        require_library("mcap")
    parts = outgoing([read_run(folder) for folder in folders])
    names = [part.run.name for part in parts]
    if len(set(names)) < len(names):
        raise ConfigurationError(f"two runs are named {max(names, key=names.count)}; rename one")
    with writing(out):
        if kind == "csv":
            from cell.record.exchange.csv_tables import write_csv as write
        elif kind == "mcap":
            from cell.record.exchange.mcap_file import write_mcap as write
        else:
            from cell.record.exchange.lerobot import write_lerobot as write
        return write(parts, out)
