"""Assembly of the command line `cell`; commands import heavy modules only when they
run.
"""

from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from cell.interface.cli.arm import home, jog, open_hand, park, register
from cell.interface.cli.calibrate import calibrate
from cell.interface.cli.devices import camera, doctor
from cell.interface.cli.exchange import export_runs, import_runs, observe
from cell.interface.cli.fold import fold
from cell.interface.cli.gap import gap
from cell.interface.cli.policies import benchmark, train, twin
from cell.interface.cli.records import learn, note, replay, report, runs, viz
from cell.interface.cli.strips import strips

COMMANDS: dict[str, dict[str, Any]] = {
    "Folds": {"fold": fold, "runs": runs, "report": report, "note": note, "viz": viz},
    "What a model lacks": {
        "gap": gap,
        "import": import_runs,
        "export": export_runs,
        "observe": observe,
    },
    "The cell": {
        "doctor": doctor,
        "calibrate": calibrate,
        "camera": camera,
        "strips": strips,
        "learn": learn,
        "home": home,
        "park": park,
        "jog": jog,
        "open": open_hand,
        "register": register,
    },
    "Policies and simulation": {
        "train": train,
        "benchmark": benchmark,
        "replay": replay,
        "twin": twin,
    },
}


WHOLE = 1000  # characters of a sentence, which is wrapped and never cut


class Grouped(TyperGroup):
    """Command group whose help lists the commands under the headings of COMMANDS."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:  # noqa: ARG002  typer's
        """Write the commands under each heading, each with its whole sentence."""
        for heading, named in COMMANDS.items():
            shown = [
                (name, self.commands[name].get_short_help_str(WHOLE)) for name in named
            ]
            with formatter.section(heading):
                formatter.write_dl(shown)


app = typer.Typer(
    name="cell",
    cls=Grouped,
    help=(
        "Fold fabric strips with feedback from a camera, on hardware or on the digital"
        " twin."
    ),
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
for name, command in (item for group in COMMANDS.values() for item in group.items()):
    if isinstance(command, typer.Typer):
        app.add_typer(command, name=name)
    else:
        app.command(name)(command)


def _print_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        print(f"cell {version('folding-cell')}")
        raise typer.Exit


@app.callback()
def main(
    version: Annotated[
        bool,
        typer.Option(
            "--version",
            callback=_print_version,
            is_eager=True,
            help="Print the version.",
        ),
    ] = False,
) -> None:
    """Fold fabric strips with feedback from a camera, on hardware or on the digital
    twin.
    """
