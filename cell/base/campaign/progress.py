"""Progress display of a campaign or a training in the terminal: steps done, time left,
failures.
"""

import time
from collections.abc import Callable
from contextlib import AbstractContextManager

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn

from cell.base.campaign.journal import Record

Describe = Callable[[Record], str]
# lines printed of a training, and of its evaluation, where there is no terminal
LINES = 20


def _failure_text(record: Record) -> str:
    """Text with state and reason of a campaign's part that was not measured; empty for
    one that was.
    """
    if record.state == "measured":
        return ""
    return f": {record.state.replace('_', ' ')}: {record.reason}"


class Meter(AbstractContextManager["Meter"]):
    """Progress bar of a campaign or a training, whose steps count by their cost; lines
    of text without a terminal.

    A measured part is a line, and one that failed stays on the screen; a training,
    whose steps are many, prints every twentieth of them. Without a `console` nothing is
    shown.
    """

    def __init__(
        self, console: Console | None = None, describe: Describe = _failure_text
    ) -> None:
        self._console = console or Console(quiet=True)
        self._describe = describe
        self._count = self._number = self._failed = 0
        self._total = self._done = self._before = 0.0
        self._started_at = time.monotonic()
        self._bar = Progress(
            BarColumn(bar_width=28),
            TextColumn("{task.description}"),
            console=self._console,
            transient=True,
        )
        self._task: TaskID | None = None

    def begin(
        self,
        count: int,
        known: int,
        cost: float | None = None,
        known_cost: float | None = None,
    ) -> None:
        """Begin to show `count` steps, of which `known` are done; `cost` and
        `known_cost` are what all and those cost, else each costs 1.
        """
        bar = self._bar
        self._count = count
        self._number = known
        self._total = float(count) if cost is None else cost
        self._done = self._before = float(known) if known_cost is None else known_cost
        self._started_at = time.monotonic()
        if known:
            self._print(f"resumed after {known} of {count}")

        if self._console.is_terminal and known < count:
            self._task = bar.add_task("", total=self._total)
            bar.update(self._task, completed=self._done)
            bar.start()

    def finish(self, cost: float, record: Record) -> None:
        """Advance the display by one finished part that had the estimated `cost`, and
        whose result is `record`.
        """
        self._number += 1
        self._failed += record.state != "measured"
        failed = f", {self._failed} failed" if self._failed else ""
        self._done += cost
        text = (
            f"{self._number} of {self._count}{failed}{self._time_left()}  {record.key}"
        )
        kept = self._task is None or record.state != "measured"
        self._show(text + self._describe(record), kept=kept)

    def step(self, done: int, text: str) -> None:
        """Advance to step number `done` of a training or of its evaluation, and show
        `text`.
        """
        self._done = float(done)
        due = done % max(1, self._count // LINES) == 0 or done == self._count
        self._show(text + self._time_left(), kept=self._task is None and due)

    def __exit__(self, *_: object) -> None:
        """Remove the progress bar from the terminal."""
        if self._task is not None:
            self._bar.stop()

    def _show(self, text: str, *, kept: bool) -> None:
        """Show `text` beside the progress bar, and if it is `kept`, print it as a
        line.
        """
        if kept:
            self._print(text)
        if self._task is not None:
            self._bar.update(self._task, completed=self._done, description=text)

    def _time_left(self) -> str:
        """Text of the estimated time left, from the time per step since the start;
        empty where it cannot be known.
        """
        here = self._done - self._before
        left = self._total - self._done
        passed = time.monotonic() - self._started_at
        if here <= 0 or left <= 0:
            return ""
        return f", {duration_text(left * passed / here)} left"

    def _print(self, text: str) -> None:
        self._console.print(text, highlight=False, soft_wrap=True, markup=False)


def duration_text(seconds: float) -> str:
    """Format a duration [s] as minutes and seconds, or hours and minutes."""
    minutes, remainder = divmod(round(seconds), 60)
    hours, short = divmod(minutes, 60)
    return f"{hours} h {short:02d} min" if hours else f"{minutes}:{remainder:02d}"
