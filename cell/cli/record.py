"""`cell report` and `cell viz`: one page on a run, and the run in Rerun."""

import json
import sys
from pathlib import Path
from typing import Annotated

import typer

from cell.cli.options import Json

Run = Annotated[Path, typer.Argument(help="A run folder.")]


def report(run: Run, as_json: Json = False) -> None:
    """Write report.html for a run, finished or not, and say in a line what it came to."""
    from cell.record.salvage import Salvage
    from cell.report.page import write_report
    from cell.report.verdict import verdict

    page = write_report(run)
    found = Salvage.of(run)
    for problem in found.problems:
        sys.stderr.write(f"cell: {problem}\n")
    sentence = verdict(found)
    if as_json:
        sys.stdout.write(json.dumps({"run": str(run), "report": str(page)}) + "\n")
        return
    sys.stdout.write(f"{sentence}\n  {page}\n")


def viz(run: Run) -> None:
    """Build the Rerun recording of a run again from its record, and say how to open it."""
    from cell.record.files import REBUILT, RECORDING
    from cell.record.salvage import Salvage
    from cell.viz.recording import viz_from_run

    path = viz_from_run(run)
    for problem in Salvage.of(run).problems:
        sys.stderr.write(f"cell: {problem}\n")
    sys.stdout.write(f"{path}\n  open it with: rerun {path}\n")
    if path.name == REBUILT:
        sys.stdout.write(f"  kept beside it: {run / RECORDING}, recorded during the fold itself\n")
