"""Command `cell learn`: shows or changes what the cell has learned from its folds."""

import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cell.base.config.length import metres
from cell.base.config.places import find_configs
from cell.interface.cli.options import Configs, Json
from cell.interface.cli.output import print_json
from cell.record.files import run_folder
from drivers.base.errors import ConfigurationError, suggestion

if TYPE_CHECKING:
    from cell.base.config.cell import CellFile
    from cell.folding.experience import Memory

WORDS = ("show", "list", "forget", "off", "on")
LONGEST_EDGES = 0.1  # m, of an offset by a ruler

What = Annotated[
    str,
    typer.Argument(
        metavar="WHAT",
        help="show, list, forget, off, on, or a run that was measured by a ruler.",
    ),
]
ForgottenRun = Annotated[
    Path | None,
    typer.Argument(
        metavar="RUN", parser=run_folder, help="With forget: the one run to forget."
    ),
]


def learn(
    what: What = "show",
    run: ForgottenRun = None,
    edges: Annotated[
        str | None,
        typer.Option(help="Offset of the run's laid edges by a ruler, as 3.5mm."),
    ] = None,
    sure: Annotated[
        bool,
        typer.Option(
            "--sure", help="Believe the ruler, however far from the camera it is."
        ),
    ] = False,
    twin: Annotated[
        bool,
        typer.Option(
            "--twin", help="What folds of the twin taught, not of the real cell."
        ),
    ] = False,
    configs: Configs = None,
    as_json: Json = False,
) -> None:
    """Show or change what the cell has learned from folds, or enter a ruler's
    measurement.
    """
    _check_arguments(what, run, edges)
    from cell.folding.experience import Memory

    settings = find_configs(configs).cell()
    memory = Memory(settings.name, twin=twin)
    if edges is not None:
        _learn_from_ruler(settings, run_folder(what), edges, sure=sure)
    elif what == "forget":
        _forget(settings, memory, run)
    elif what == "list":
        from cell.folding.summary import experience_lines

        if as_json:
            print_json(*map(asdict, memory.experiences()))
        else:
            sys.stdout.write(experience_lines(memory.experiences()))
    elif what == "show":
        _show(memory, settings, as_json=as_json)
    else:
        memory.switch(on=what == "on")
        print(f"{settings.name}: learning is {what}")


def _check_arguments(what: str, run: Path | None, edges: str | None) -> None:
    """Raise ConfigurationError for arguments of `cell learn` that contradict each
    other.
    """
    if what not in WORDS and edges is None:
        raise ConfigurationError(
            f"{what!r}{suggestion(what, WORDS)} is neither show, list, forget, off nor"
            " on; a run goes with --edges, the offset of its laid edges by a ruler, as"
            " `--edges 3.5mm`"
        )
    if what in WORDS and edges is not None:
        raise ConfigurationError(
            "--edges: goes with a run, as `cell learn runs/RUN --edges 3.5mm`"
        )
    if run is not None and what != "forget":
        raise ConfigurationError(
            f"{run}: goes with forget alone, as `cell learn forget {run}`"
        )


def _memory_of(settings: "CellFile", run: Path) -> "Memory":
    """Memory that holds the fold `run`: the one of the twin or that of the real
    cell.
    """
    from cell.folding.experience import Memory

    twin = Memory(settings.name, twin=True)
    return twin if twin.find(run) else Memory(settings.name)


def _learn_from_ruler(
    settings: "CellFile", run: Path, edges: str, *, sure: bool
) -> None:
    """Learn from the ruler's offset `edges` of the laid edges of `run`."""
    from cell.folding.bias import check_ruler
    from cell.folding.experience import experience_by_ruler

    offset = metres("--edges", edges, LONGEST_EDGES)
    memory = _memory_of(settings, run)
    experience = experience_by_ruler(run, offset, memory)
    if not sure:
        check_ruler(offset, experience.rig)
    memory.add(experience)
    print(
        f"{run.name}: the ruler shows {1e3 * experience.rig:+.1f} mm more than the"
        " camera"
    )


def _forget(settings: "CellFile", memory: "Memory", run: Path | None) -> None:
    """Set aside what was learned from `run`, or everything."""
    if run is not None:
        memory = _memory_of(settings, run)
    aside = memory.forget(run)
    if aside is not None:
        print(f"set aside: {aside}")
    elif run is None:
        print("nothing was learned yet")
    else:
        raise ConfigurationError(
            f"{run}: nothing was learned from this run; `cell learn list` names those"
            " that taught"
        )


def _show(memory: "Memory", settings: "CellFile", *, as_json: bool) -> None:
    """Print the learned biases, by policy, strip and specimen."""
    from cell.folding.summary import largest_text, summary_rows, summary_text

    rows = summary_rows(memory.experiences())
    if as_json:
        print_json(*rows)
        return
    state = "off" if memory.is_off else settings.learning.use
    print(f"{settings.name}: learning is {state}")
    sys.stdout.write(summary_text(rows))
    if rows:
        sys.stdout.write(largest_text(memory))
