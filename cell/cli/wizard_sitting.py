"""Session of a calibration wizard at a terminal: panel, single keys, Ctrl-C, recording."""

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from cell.cli.options import Viz

if TYPE_CHECKING:
    from calibration.wizard.news import News, Watcher
    from calibration.wizard.verdict import Line
    from cell.calibrating.wizard_panel import WizardPanel
    from cell.devices.devices import Devices
    from cell.orchestrator.operator import Operator


class Sitting:
    """Session of a wizard: its terminal `panel`, observer `watch`, and `interrupted` by Ctrl-C."""

    def __init__(self, panel: "WizardPanel", interrupted: "Callable[[], bool]") -> None:
        self.panel = panel
        self.watch: Watcher = panel
        self.interrupted = interrupted
        self.record: Callable[[str], None] = lambda _: None

    def say(self, lines: "Iterable[Line]") -> None:
        """Add the verdict to the recording."""
        self.record("\n".join(line.text for line in lines))

    def operator(self, devices: "Devices", *, interactive: bool) -> "Operator":
        """Operator of `devices` who answers at this terminal."""
        from cell.calibrating.keyboard import operator_of

        return operator_of(devices, self.panel.ask, self.interrupted, interactive=interactive)


@contextmanager
def terminal() -> Iterator[Sitting]:
    """Open a session at the terminal, with panel, single keys and Ctrl-C."""
    from rich.console import Console

    from cell.calibrating.keyboard import single_keys
    from cell.calibrating.wizard_panel import WizardPanel
    from cell.orchestrator.interrupt import Interrupt

    panel = WizardPanel(Console(stderr=True))
    with Interrupt() as interrupted, single_keys(sys.stdin), panel:
        yield Sitting(panel, interrupted)


@contextmanager
def sitting(folder: Path, kind: str, viz: Viz) -> Iterator[Sitting]:
    """Open a wizard's session; unless `viz` is off, all is drawn into wizard.rrd too.

    Raises Interrupted that says what `folder` keeps, after one Ctrl-C as after two.
    """
    from cell.orchestrator.interrupt import Interrupted

    try:
        with terminal() as at:
            if viz == "off":
                yield at
                return
            from cell.report.viz.wizard import wizard_screen

            folder.mkdir(parents=True, exist_ok=True)
            with wizard_screen(folder, live=viz == "live") as screen:

                def both(news: "News") -> None:
                    at.panel(news)
                    screen(news)

                at.watch, at.record = both, screen.verdict
                yield at
    except (Interrupted, KeyboardInterrupt):
        raise Interrupted(_resume_hint(folder, kind)) from None


def _resume_hint(folder: Path, kind: str) -> str:
    """Text on an interrupted session: what `folder` keeps, and how to resume."""
    from calibration.wizard.session import ROWS_FILE, read_rows
    from cell.report.words import plural

    taken = sum(row.taken for row in read_rows(folder)) if (folder / ROWS_FILE).is_file() else 0
    if taken == 0:
        return f"interrupted; nothing was taken yet; {folder} may be deleted"
    return (
        f"interrupted; {plural(taken, 'image')} kept in {folder}: `cell calibrate {kind} --resume "
        f"{folder}` goes on, `cell calibrate {kind} --from {folder}` solves them"
    )
