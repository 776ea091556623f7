"""Commands `cell import` and `cell export`: convert runs from and to other formats."""

import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from cell.cli.options import Configs, Json, busy, print_json, run_folder
from cell.report.words import plural

if TYPE_CHECKING:
    from cell.record.run import Run


def import_runs(
    places: Annotated[
        list[Path],
        typer.Argument(
            metavar="PLACE",
            help="A folder with the tables of a run, an MCAP file, or a LeRobot data set.",
        ),
    ],
    out: Annotated[Path, typer.Option(help="Folder in which the runs are written.")],
    mapping: Annotated[
        Path | None,
        typer.Option(help="File that says which column holds what; exported runs have their own."),
    ] = None,
    configs: Configs = None,
    as_json: Json = False,
) -> None:
    """Write run folders from tables of other programs, checked and converted, ready for a fit."""
    from cell.config.places import find_configs
    from cell.gap.subject.strip.runs import check_fold
    from cell.record.exchange.import_runs import import_runs as convert
    from cell.record.run import read_run

    found = find_configs(configs)
    with busy("reading the tables"):
        check = partial(check_fold, found.strip_names(), found.strip)
        made = convert(places, mapping, out, check)
    for folder in made if as_json else ():
        print_json({"run": folder})
    if not as_json:
        runs = [read_run(folder) for folder in made]
        sys.stdout.writelines(f"{_summary(run)}\n" for run in runs)
        sys.stdout.write(f"{plural(len(made), 'run')} in {out}\n")
        strip = runs[0].header.strip
        sys.stdout.write(f"next: cell gap fit {out} --strip {strip} --out {out}-fit\n")


def _summary(run: "Run") -> str:
    """Duration and quantities of an imported run."""
    touch = None if run.result is None else run.result.t_layer_touch
    seen = "no touch" if touch is None else f"touch at {touch:.2f} s"
    images = plural(len(set(run.profile.t.tolist())), "image")
    return f"{run.name}: {run.ticks.t[-1]:.2f} s; {images}, {seen}"


def export_runs(
    runs: Annotated[
        list[str],
        typer.Argument(metavar="RUN", help="Run folders; for mjcf and newton names of strips."),
    ],
    out: Annotated[Path, typer.Option(help="New folder for the files.")],
    kind: Annotated[
        Literal["lerobot", "mcap", "csv", "mjcf", "newton"],
        typer.Option("--format", help="Of runs a LeRobot set, MCAP, or CSV; of strips a model."),
    ] = "lerobot",
    configs: Configs = None,
    as_json: Json = False,
) -> None:
    """Write runs, stamps exact and read by `cell import`, or strips, for other programs."""
    from cell.config.places import find_configs
    from cell.record.exchange.export_runs import export_runs as convert
    from cell.strips.export_strip import export_strips

    with busy("writing the files"):
        match kind:
            case "mjcf" | "newton":
                strips = [find_configs(configs).strip(name) for name in runs]
                made = export_strips(strips, kind, out)
            case _:
                made = dict.fromkeys(convert([run_folder(name) for name in runs], kind, out), ())
    for path, unsaid in made.items():
        if as_json:
            print_json({"file": path} | ({"not_said": unsaid} if unsaid else {}))
        else:
            sys.stdout.writelines([f"{path}\n", *(f"  not said: {each}\n" for each in unsaid)])
