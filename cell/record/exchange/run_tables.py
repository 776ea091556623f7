"""A run's measurements as plain tables, and the mapping by which `cell import` reads them again."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from cell.record.exchange.mapping import units_of
from cell.record.run import Run
from drivers.errors import ConfigurationError
from drivers.types import Array

TICK_COLUMNS = ("t", "x", "z", "pitch", "x_cmd", "z_cmd", "f_x", "f_z")
TOUCH_FIELDS = ("t_layer_touch", "l1", "l2", "displacement")
Name = Callable[[str, str], tuple[str, str]]
"""Function from a table and its column to the file and column that hold it in a format."""


@dataclass(frozen=True, slots=True)
class RunTables:
    """A run to export, with its measurements: name of a table -> columns (n,) in SI units.

    The tables are `ticks`, and where they were measured `contact`, `profile` and `result`.
    """

    run: Run
    tables: Mapping[str, Mapping[str, Array]]

    @classmethod
    def of(cls, run: Run) -> Self:
        """Collect the tables of `run`, without empty columns; ConfigurationError without rows."""
        if not len(run.ticks.t):
            raise ConfigurationError(f"{run.folder}: holds no row; leave it out")
        ticks = {name: np.asarray(getattr(run.ticks, name)) for name in TICK_COLUMNS}
        found = {"ticks": {name: v for name, v in ticks.items() if np.isfinite(v).any()}}
        seen = np.isfinite(run.ticks.contact_x)
        stamps = np.where(np.isfinite(run.ticks.contact_t), run.ticks.contact_t, run.ticks.t)
        if seen.any():
            found["contact"] = {"t": stamps[seen], "contact_x": run.ticks.contact_x[seen]}
        if len(run.profile.t):
            found["profile"] = {name: getattr(run.profile, name) for name in ("t", "i", "x", "z")}
        touch = {name: getattr(run.result, name, None) for name in TOUCH_FIELDS}
        if None not in touch.values():
            found["result"] = {name: np.array([value]) for name, value in touch.items()}
        return cls(run, found)


def check_alike(runs: Sequence[Run]) -> None:
    """Raise ConfigurationError where no single mapping describes all `runs`."""
    for run in runs:
        alike = ("strip", "start", "sigma", "contact_height")
        if any(getattr(run.header, k) != getattr(runs[0].header, k) for k in alike):
            raise ConfigurationError(
                f"{run.folder}: differs from {runs[0].folder} in strip, start or sigma; export "
                "runs of one kind together, or as lerobot or mcap"
            )


def mapping_of(parts: Sequence[RunTables], name: Name) -> dict[str, Any]:
    """Contents of the mapping file of exported runs; `name` gives the format's file and column.

    A table or column is described where every run has it, the touch where any has.
    """
    header = parts[0].run.header
    content: dict[str, Any] = {
        "schema": 1,
        "strip": header.strip,
        "start": header.start,
        "begin": 0.0,
        "contact_height": header.contact_height,
        "sigma": header.sigma.model_dump(exclude_unset=True),
        "runs": {part.run.name: _place(part.run, i) for i, part in enumerate(parts)},
    }
    if all(part.run.header.by_cell for part in parts):
        content["seen_by"] = "cell"
    for table in ("ticks", "contact", "profile", "result"):
        present = [part.tables[table] for part in parts if table in part.tables]
        if present and (table == "result" or len(present) == len(parts)):
            shared = [column for column in present[0] if all(column in each for each in present)]
            file, _ = name(table, shared[0])
            columns = {
                c: {"column": name(table, c)[1], "unit": next(iter(units_of(c)))} for c in shared
            }
            content[table] = {"file": file, "columns": columns}
    return content


def _place(run: Run, place: int) -> dict[str, object]:
    index = place if run.header.index is None else run.header.index
    condition = run.header.condition
    return {"index": index} | ({} if condition is None else {"condition": condition})
