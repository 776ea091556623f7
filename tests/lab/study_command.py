"""The command `study`: measures a property of the cell over many cases."""

import os
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cell.interface.cli.options import Cluster, engine, resumable

if TYPE_CHECKING:
    from cell.base.campaign.run import Engine
    from tests.lab.studies.campaign import StudyRequest


def study(
    name: Annotated[
        str | None, typer.Argument(help="Which study; without, all are listed.")
    ] = (None),
    seed: Annotated[int, typer.Option(min=0, help="Seed of the cases.")] = 0,
    count: Annotated[
        int | None, typer.Option(min=1, help="Cases [default: the usual].")
    ] = None,
    jobs: Annotated[int, typer.Option(min=1, help="Cases side by side.")] = 1,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder of the study [default: runs/studies/NAME-SEED]."),
    ] = None,
    shard: Annotated[
        str | None,
        typer.Option(help="Measure share i of n alone, as 3/40; OUT can be merged."),
    ] = None,
    cluster: Cluster = None,
    show: Annotated[
        bool,
        typer.Option(
            "--show", help="Print the table of what OUT holds; measure nothing."
        ),
    ] = False,
    quick: Annotated[
        bool,
        typer.Option(
            "--quick",
            help=(
                "The smallest size, no bar judged; without NAME, every study of"
                " seconds."
            ),
        ),
    ] = False,
    models: Annotated[
        Path | None,
        typer.Option(help="Folder of models that others wrote, for `mechanisms`."),
    ] = None,
    spoilt: Annotated[
        bool,
        typer.Option(
            "--spoilt", help="Spoil a fifth of the recordings of `mechanisms`."
        ),
    ] = False,
    again: Annotated[
        bool, typer.Option("--again", help="Measure anew what OUT already holds.")
    ] = False,
) -> None:
    """Measure something of the cell over many cases: with a table and intervals.

    A case that OUT holds, by the same code, is done: the same command goes on where it
    stopped.
    """
    from drivers.base.errors import ConfigurationError
    from tests.lab.studies.campaign import StudyRequest
    from tests.lab.studies.catalogue import studies, study_of

    if models is not None:
        # processes of the study inherit it
        os.environ["STUDY_MODELS"] = str(models.resolve())
    if spoilt:
        os.environ["STUDY_SPOILT"] = "yes"
    if name is None and not quick:
        _print_studies()
        return
    chosen = (
        [s for s in studies().values() if s.quick] if name is None else [study_of(name)]
    )
    kept = True
    for each in chosen:
        size = count or (max(each.quick, 1) if quick else each.usual)
        folder = _study_folder(out, f"{each.name}-{seed}", alone=name is not None)
        asked = StudyRequest(each, seed, size, folder)
        if show and not asked.journal.is_dir():
            raise ConfigurationError(
                f"--show: {folder} holds no case of {each.name}; measure some first,"
                " without it"
            )
        if not show:
            by = engine(jobs, cluster, each.limit)
            measure_here(asked, by, _shard(shard), again=again)
        held, lost = _print_study(asked)
        kept = (held or quick) and not (lost and shard is None) and kept
    sys.exit(0 if kept or show else 1)


def _study_folder(out: Path | None, own: str, *, alone: bool) -> Path:
    """Folder of a study: OUT itself for one that runs alone, or else the folder `own`
    in it.
    """
    if out is not None and alone:
        return out
    return (out or Path("runs/studies")) / own


def _print_studies() -> None:
    from tests.lab.studies.catalogue import studies

    for each in studies().values():
        cost = f"{each.usual} cases of {each.seconds:g} s"
        sys.stdout.write(f"{each.name:14s} {cost:22s} {each.question}\n")


def _shard(given: str | None) -> tuple[int, int]:
    from drivers.base.errors import ConfigurationError

    found = re.fullmatch(r"(\d+)/(\d+)", given or "1/1")
    number, count = map(int, found.groups()) if found else (0, 0)
    if not 1 <= number <= count:
        raise ConfigurationError(
            f"--shard: {given!r}; give i/n with i from 1 to n, like 3/40"
        )
    return number, count


def measure_here(
    asked: "StudyRequest", by: "Engine", shard: tuple[int, int], *, again: bool
) -> None:
    """Measure what the folder of a study lacks, with a meter on the screen."""
    from rich.console import Console

    from cell.base.campaign.progress import Meter
    from tests.lab.studies.campaign import measure

    with resumable(asked.folder), Meter(Console(stderr=True)) as meter:
        measure(asked, by, meter, shard, again=again)


def _print_study(asked: "StudyRequest") -> tuple[bool, bool]:
    """Print a study and write its table; returns whether bars are kept and cases
    failed.
    """
    from tests.lab.studies.campaign import read_study
    from tests.lab.studies.table import keeps_bars, markdown, rows, write_table

    found = read_study(asked)
    written = write_table(found)
    sys.stdout.write(f"{asked.study.question}\n\n{markdown(found)}  {written}\n")
    return keeps_bars(rows(found)), bool(found.lost)
