"""Assembly of the command line `cell`; commands import heavy modules only when they run."""

import sys
from typing import Annotated

import typer

from cell.cli.arm import home, jog, open_hand, park, register
from cell.cli.benchmark import benchmark
from cell.cli.calibrate import calibrate
from cell.cli.camera import camera
from cell.cli.doctor import doctor
from cell.cli.fold import fold
from cell.cli.gap import gap
from cell.cli.import_runs import export_runs, import_runs
from cell.cli.learn import learn
from cell.cli.observe import observe
from cell.cli.record import note, report, viz
from cell.cli.replay import replay
from cell.cli.runs import runs
from cell.cli.strips import strips
from cell.cli.train import train
from cell.cli.twin import twin

app = typer.Typer(
    name="cell",
    help="Fold fabric strips with feedback from a camera, on hardware or on the digital twin.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
app.command()(fold)
app.command()(doctor)
app.command()(runs)
app.command()(learn)
app.command(name="import")(import_runs)
app.command(name="export")(export_runs)
app.command()(observe)
app.command()(report)
app.command()(note)
app.command()(viz)
app.command()(replay)
app.command()(camera)
app.add_typer(calibrate, name="calibrate")
app.command()(home)
app.command()(park)
app.command()(jog)
app.command(name="open")(open_hand)
app.command()(register)
app.add_typer(strips, name="strips")
app.command()(benchmark)
app.add_typer(gap, name="gap")
app.command()(train)
app.add_typer(twin, name="twin")


def _print_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        sys.stdout.write(f"cell {version('folding-cell')}\n")
        raise typer.Exit


@app.callback()
def main(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version."
        ),
    ] = False,
) -> None:
    """Fold fabric strips with feedback from a camera, on hardware or on the digital twin."""
