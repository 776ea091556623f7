"""Options of both calibration wizards, and the folder of a session."""

from collections.abc import Iterator
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from calibration.wizard.news import TouchNews, ViewNews, Watcher
    from calibration.wizard.words import Line
    from cell.operations.wizard_panel import WizardPanel

SESSIONS = Path("calibrations")


class WizardViz(StrEnum):
    """What happens with the Rerun recording of a calibration."""

    SAVE = "save"
    LIVE = "live"
    OFF = "off"


Out = Annotated[
    Path | None,
    typer.Option(help="Folder of this session, new [default: calibrations/TIME-CELL-KIND]."),
]
From = Annotated[
    Path | None, typer.Option("--from", help="Solve the session in this folder again instead.")
]
Without = Annotated[
    list[int] | None,
    typer.Option(help="With --from: leave the image or point with this number out; repeatable."),
]
Interactive = Annotated[
    bool, typer.Option("--interactive", help="Ask before each step on the twin too.")
]
Viz = Annotated[WizardViz, typer.Option(help="Rerun: save a recording, show it live too, off.")]


def session_folder(out: Path | None, cell: str, kind: str) -> Path:
    """The folder given by --out, or a new one named by time; an existing one is refused."""
    from datetime import UTC, datetime

    from drivers.errors import ConfigurationError

    if out is None:
        return SESSIONS / f"{datetime.now(UTC):%Y%m%dT%H%M%SZ}-{cell}-{kind}"
    if out.exists() and any(out.iterdir() if out.is_dir() else [out]):
        raise ConfigurationError(f"--out: {out} is there already; name a new folder")
    return out


@contextmanager
def watching(panel: "WizardPanel", folder: Path, viz: WizardViz) -> Iterator["Watcher"]:
    """An observer that draws into the terminal and, unless `viz` is off, into wizard.rrd."""
    with panel:
        if viz is WizardViz.OFF:
            yield panel
            return
        from cell.viz.wizard import watched

        folder.mkdir(parents=True, exist_ok=True)
        with watched(folder, live=viz is WizardViz.LIVE) as screen:

            def both(news: "ViewNews | TouchNews") -> None:
                panel(news)
                screen(news)

            yield both


def tell_verdict(lines: "tuple[Line, ...]") -> None:
    """Print the verdict, in colour where the terminal supports it."""
    from rich.console import Console

    from cell.operations.wizard_panel import verdict_text

    Console(highlight=False, soft_wrap=True).print(verdict_text(lines), end="")
