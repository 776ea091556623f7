"""`cell runs`: list the runs of a folder, or let old ones go."""

import json
import sys
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cell.cli.options import Json, Runs

if TYPE_CHECKING:
    from cell.record.listing import RunRow

MEGABYTE = 1e6


def runs(
    folder: Runs = Path("runs"),
    keep: Annotated[
        int | None, typer.Option(help="Let go of all but the newest this many.")
    ] = None,
    older_than: Annotated[
        float | None,
        typer.Option(min=0, max=36500, help="Let go of runs older than this many days."),
    ] = None,
    delete: Annotated[
        bool, typer.Option("--delete", help="Really delete what --keep or --older-than name.")
    ] = False,
    as_json: Json = False,
) -> None:
    """List the runs in a folder; with --keep or --older-than, those that may go."""
    from cell.record.listing import list_runs, remove, to_prune

    rows = list_runs(folder)
    pruning = keep is not None or older_than is not None
    if pruning:
        age = None if older_than is None else timedelta(days=_days(older_than))
        rows = to_prune(rows, datetime.now(UTC), keep=keep, older_than=age)
    _show(rows, as_json=as_json)
    if pruning and delete:
        freed = remove(rows)
        sys.stderr.write(f"deleted {len(rows)} runs, {freed / MEGABYTE:.1f} MB\n")
    elif pruning:
        sys.stderr.write(f"{len(rows)} runs may go; nothing was deleted, add --delete\n")


def _days(stated: float) -> float:
    from drivers.errors import ConfigurationError

    if isnan(stated):
        raise ConfigurationError("--older-than: is nan; give a number of days")
    return stated


def _show(rows: "Sequence[RunRow]", *, as_json: bool) -> None:
    if as_json:
        for row in rows:
            facts = {"run": str(row.folder), "strip": row.strip, "policy": row.policy}
            facts |= {"outcome": row.outcome, "began": row.began.isoformat()}
            numbers = {"displacement": row.displacement, "duration": row.duration}
            sys.stdout.write(json.dumps({**facts, **numbers, "size": row.size}) + "\n")
        return
    _print_table(rows)


def _print_table(rows: "Sequence[RunRow]") -> None:
    from cell.cli.table import print_table

    columns = ("run", "strip", "policy", "outcome", "d mm", "s", "MB")
    print_table(columns, [_cells(row) for row in rows], text=4)


def _cells(row: "RunRow") -> tuple[str, ...]:
    shown = "" if row.displacement is None else f"{1e3 * row.displacement:+.1f}"
    lasted = "" if row.duration is None else f"{row.duration:.1f}"
    size = f"{row.size / MEGABYTE:.1f}"
    return (row.name, row.strip, row.policy, row.outcome, shown, lasted, size)
