"""The command `cell benchmark`: folds the paper's strips and compares with its numbers."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from cell.cli.options import Cluster, Configs, Json, engine, print_json, resumable
from cell.cli.table import print_table

PART_TIMEOUT = 7200.0  # s of a part


def benchmark(
    policies: Annotated[str | None, typer.Option(help="Policies, with commas [default: all].")] = (
        None
    ),
    strips: Annotated[str | None, typer.Option(help="Strips, with commas [default: all].")] = None,
    repeat: Annotated[
        int | None, typer.Option(min=1, help="Folds of one strip by each policy [default: 5].")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the noise; repeats use the next.")] = 0,
    jobs: Annotated[int, typer.Option(min=1, help="Parts measured side by side.")] = 1,
    cluster: Cluster = None,
    out: Annotated[Path, typer.Option(help="Folder of the results.")] = Path("runs/benchmark"),
    runs: Annotated[
        Path | None, typer.Option(help="Folder in which folds are recorded [default: OUT/runs].")
    ] = None,
    configs: Configs = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Three strips, two repeats, coarse grids.")
    ] = False,
    again: Annotated[
        bool, typer.Option("--again", help="Measure anew what OUT already holds.")
    ] = False,
    picture: Annotated[
        Path | None, typer.Option(help="Write the main picture there too, as PNG.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Fold all strips by all policies, and show it beside the paper's numbers.

    What is finished is kept in OUT: a benchmark that was interrupted goes on where it stopped.
    """
    from rich.console import Console

    from cell.benchmark.page import lines, write_main_picture, write_results
    from cell.benchmark.results import BenchmarkSpec, split
    from cell.benchmark.run import benchmark as measure
    from cell.benchmark.run import summarise
    from cell.benchmark.summary import claim_lines, tables
    from cell.campaign.progress import Meter
    from cell.config.places import find_configs

    found = find_configs(configs)
    spec = BenchmarkSpec.build(found, split(policies), split(strips), repeat, seed, quick=quick)
    by = engine(jobs, cluster, PART_TIMEOUT)
    place = runs or out / "runs"
    with resumable(out), Meter(Console(stderr=True), summarise) as meter:
        results = measure(spec, found, out, place, engine=by, again=again, watcher=meter)
    page = write_results(results, out)
    if picture is not None:
        write_main_picture(results, picture)
    if as_json:
        for line in lines(results):
            print_json(line)
        return
    for table in tables(results):
        print_table(*table)
    sys.stdout.writelines(f"  {line}\n" for line in (*claim_lines(results), page))
