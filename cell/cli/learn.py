"""The command `cell learn`: shows or changes what the cell learned from its folds."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cell.cli.options import Configs, Json, print_json

if TYPE_CHECKING:
    from cell.config.cell import CellFile
    from cell.learning.experience import Memory

WORDS = ("show", "forget", "off", "on")


def learn(
    what: Annotated[
        str, typer.Argument(help="show, forget, off, on, or a run that was measured by a ruler.")
    ] = "show",
    edges: Annotated[
        str | None, typer.Option(help="Offset of the run's laid edges by a ruler, as 3.5mm.")
    ] = None,
    configs: Configs = None,
    as_json: Json = False,
) -> None:
    """Show or change what the cell learned from its folds; a ruler counts more than the camera."""
    from cell.config.places import find_configs
    from cell.learning.experience import Memory
    from drivers.errors import ConfigurationError, suggestion

    settings = find_configs(configs).cell()
    memory = Memory(settings.name)
    if what not in WORDS:
        if edges is None:
            raise ConfigurationError(
                f"{what!r}{suggestion(what, WORDS)} is neither show, forget, off nor on; a run "
                "goes with --edges, the offset of its laid edges by a ruler, as `--edges 3.5mm`"
            )
        _learn_from_ruler(settings.name, Path(what), edges)
        return
    if edges is not None:
        raise ConfigurationError("--edges: goes with a run, as `cell learn runs/RUN --edges 3.5mm`")
    if what == "show":
        _show(memory, settings, as_json=as_json)
    elif what == "forget":
        aside = memory.forget()
        sys.stdout.write("nothing was learned yet\n" if aside is None else f"set aside: {aside}\n")
    else:
        memory.switch(on=what == "on")
        sys.stdout.write(f"{settings.name}: learning is {what}\n")


def _learn_from_ruler(cell: str, folder: Path, edges: str) -> None:
    from cell.config.length import metres
    from cell.folding.correct import learn_from_ruler

    experience = learn_from_ruler(folder, metres("--edges", edges, 0.1), cell)
    sys.stdout.write(
        f"{folder.name}: the ruler shows {1e3 * experience.rig:+.1f} mm more than the camera\n"
    )


def _show(memory: "Memory", settings: "CellFile", *, as_json: bool) -> None:
    from cell.learning.summary import summaries, table

    rows = summaries(memory.experiences(), settings.learning)
    if as_json:
        for row in rows:
            print_json(row)
        return
    state = "off" if memory.is_off else settings.learning.use
    sys.stdout.write(f"{settings.name}: learning is {state}\n")
    sys.stdout.write(table(rows))
