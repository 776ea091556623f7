"""The command `cell runs`: lists and filters the runs of a folder, or deletes old ones."""

import csv
import sys
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cell.cli.options import Json, Runs, busy, print_json
from cell.report.words import plural
from drivers.errors import ConfigurationError

if TYPE_CHECKING:
    from cell.record.listing import RunRow

MEGABYTE = 1e6


def runs(
    folder: Runs = Path("runs"),
    where: Annotated[
        str, typer.Option(help='Only runs for which this SQL holds, as "abs(displacement) > 0.01".')
    ] = "",
    sort: Annotated[
        str, typer.Option(help="Column to sort by, as edge_offset; -COLUMN downwards.")
    ] = "",
    as_csv: Annotated[bool, typer.Option("--csv", help="All columns as CSV, in SI units.")] = False,
    html: Annotated[
        Path | None, typer.Option(help="Write the list there as one page with thumbnails.")
    ] = None,
    keep: Annotated[int | None, typer.Option(min=0, help="Keep only the newest this many.")] = None,
    older_than: Annotated[
        float | None,
        typer.Option(min=0, max=36500, help="Keep only runs of this many days or less."),
    ] = None,
    delete: Annotated[
        bool, typer.Option("--delete", help="Really delete what --keep or --older-than name.")
    ] = False,
    as_json: Json = False,
) -> None:
    """List the runs in a folder; with --keep or --older-than, those that may go."""
    from cell.record.listing import list_runs, remove, to_prune

    pruning = keep is not None or older_than is not None or delete
    if delete and html is not None:
        raise ConfigurationError("--keep, --older-than, --delete: go without --html")
    with busy("reading the runs"):
        rows = list_runs(folder, where, sort)
    if pruning:
        age = None if older_than is None else timedelta(days=_require_number(older_than))
        rows = to_prune(rows, datetime.now(UTC), keep=keep, older_than=age)
    if html is not None:
        from cell.report.runs_page import write_runs_page

        sys.stdout.write(f"{plural(len(rows), 'run')}\n  {write_runs_page(rows, html)}\n")
        return
    _print_rows(rows, as_csv=as_csv, as_json=as_json)
    if pruning and delete:
        freed = remove(rows)
        sys.stderr.write(f"deleted {plural(len(rows), 'run')}, {freed / MEGABYTE:.1f} MB\n")
    elif pruning:
        sys.stderr.write(f"{plural(len(rows), 'run')} may go; nothing was deleted, add --delete\n")


def _require_number(stated: float) -> float:
    if isnan(stated):
        raise ConfigurationError("--older-than: is nan; give a number of days")
    return stated


def _print_rows(rows: "Sequence[RunRow]", *, as_csv: bool, as_json: bool) -> None:
    if as_csv:
        from cell.record.listing import COLUMNS, values_of

        writer = csv.writer(sys.stdout, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows(map(values_of, rows))
    elif as_json:
        for row in rows:
            print_json(_row_facts(row))
    else:
        _print_table(rows)


def _row_facts(row: "RunRow") -> dict[str, Any]:
    keys = ("strip", "policy", "outcome", "displacement", "edge_offset", "duration", "size")
    facts: dict[str, Any] = {"run": str(row.folder), "began": row.began.isoformat()}
    facts |= {key: getattr(row, key) for key in keys}
    if row.tags or row.note:
        facts |= {"tags": row.tags.split(), "note": row.note}
    return facts


def _print_table(rows: "Sequence[RunRow]") -> None:
    from cell.cli.table import print_table

    tagged = any(row.tags for row in rows)
    columns = ("run", "strip", "policy", "outcome", *(("tags",) if tagged else ()))
    shown = [
        (r.short, r.strip, r.policy, r.outcome, *((r.tags,) if tagged else ()), *_numbers(r))
        for r in rows
    ]
    print_table((*columns, "d mm", "edge mm", "s", "MB"), shown, text=len(columns))


def _numbers(row: "RunRow") -> tuple[str, ...]:
    lengths = (row.displacement, row.edge_offset)
    shown = ["" if length is None else f"{1e3 * length:+.1f}" for length in lengths]
    lasted = "" if row.duration is None else f"{row.duration:.1f}"
    return (*shown, lasted, f"{row.size / MEGABYTE:.1f}")
