"""The command `cell gap rehearse`: finds which effects given runs could have revealed."""

import os
import sys
from pathlib import Path
from typing import Annotated

import typer

from cell.cli.options import Cluster, Configs, Json, RunFolders, Strip, engine, resumable

COPY_TIMEOUT = 3600.0  # s of a copy


def rehearse(
    runs: RunFolders,
    strip: Strip,
    out: Annotated[Path, typer.Option("--out", help="Folder of plan, outcomes and page.")],
    excess: Annotated[
        float, typer.Option(min=0.3, max=20.0, help="Gap that a hidden effect leaves, in noise.")
    ] = 2.5,
    empty: Annotated[int, typer.Option(min=0, help="Copies with nothing hidden.")] = 5,
    jobs: Annotated[int, typer.Option(min=1, help="Copies side by side.")] = 1,
    cluster: Cluster = None,
    configs: Configs = None,
    as_json: Json = False,
) -> None:
    """Hide each effect in turn in simulated copies of these runs: which would have been named?

    What is finished is kept in OUT: the same command goes on where it stopped.
    """
    from rich.console import Console

    from cell.campaign.progress import Meter
    from cell.cli.gap_plan import strip_file
    from cell.gap.rehearse import plan, progress_line, write_page
    from cell.gap.rehearse import rehearse as carry_out

    file = strip_file(strip, configs)
    wide = min(jobs, os.cpu_count() or 1)
    chosen = engine(wide, cluster, COPY_TIMEOUT)
    made = plan(runs, file, out, excess, empty, wide)
    with resumable(out), Meter(Console(stderr=True), progress_line, quiet=as_json) as meter:
        records = carry_out(made, out, chosen, meter)
    page = write_page(made, records, out)
    if as_json:
        sys.stdout.write((out / "rehearsal.json").read_text(encoding="utf-8") + "\n")
        return
    sys.stdout.write(page.read_text(encoding="utf-8"))
