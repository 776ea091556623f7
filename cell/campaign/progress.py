"""Progress of a campaign in the terminal: parts done, time left, failures."""

import time
from collections.abc import Callable, Sequence

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn

from cell.campaign.journal import Record
from cell.campaign.run import Part

Describe = Callable[[Record], str]


def failure_text(record: Record) -> str:
    """Text on a record: empty where the part was measured, else its state and reason."""
    if record.state == "measured":
        return ""
    return f": {record.state.replace('_', ' ')}: {record.reason}"


class Meter:
    """Progress bar weighted by the parts' cost; without a terminal, a line for each part.

    Parts that failed stay on the screen.
    """

    def __init__(
        self, console: Console, describe: Describe = failure_text, *, quiet: bool = False
    ) -> None:
        self._console, self._describe, self._quiet = console, describe, quiet
        self._count = self._done = self._failed = 0
        self._total = self._known = self._before = 0.0
        self._started_at = time.monotonic()
        self._bar = Progress(BarColumn(bar_width=28), TextColumn("{task.description}"),
                             console=console, transient=True)  # fmt: skip
        self._task: TaskID | None = None

    def begin(self, parts: Sequence[Part], known: Sequence[Part]) -> None:
        """Show the initial progress."""
        self._count, self._done = len(parts), len(known)
        self._total, self._known = sum(p.cost for p in parts), sum(p.cost for p in known)
        self._before = self._known
        self._started_at = time.monotonic()
        if self._quiet:
            return
        if known:
            self._print(f"{len(known)} of {len(parts)} are known already")
        if self._console.is_terminal and len(known) < len(parts):
            self._task = self._bar.add_task("", total=self._total)
            self._bar.update(self._task, completed=self._known)
            self._bar.start()

    def finish(self, part: Part, record: Record) -> None:
        """Advance the bar by one part."""
        self._done += 1
        self._failed += record.state != "measured"
        self._known += part.cost
        if self._quiet:
            return
        failed = f", {self._failed} failed" if self._failed else ""
        text = f"{self._done} of {self._count}{failed}{self._time_left()}  {part.key}"
        text += self._describe(record)
        if self._task is None or record.state != "measured":
            self._print(text)
        if self._task is not None:
            self._bar.update(self._task, completed=self._known, description=text)

    def close(self) -> None:
        """Remove the bar."""
        if self._task is not None:
            self._bar.stop()

    def __enter__(self) -> "Meter":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _time_left(self) -> str:
        """Estimated time left, from the time of the parts measured here."""
        here, passed = self._known - self._before, time.monotonic() - self._started_at
        left = self._total - self._known
        return f", {duration_text(left * passed / here)} left" if here > 0 and left > 0 else ""

    def _print(self, text: str) -> None:
        self._console.print(text, highlight=False, soft_wrap=True, markup=False)


def duration_text(seconds: float) -> str:
    """Format a duration [s] as minutes and seconds, or hours and minutes."""
    minutes, rest = divmod(round(seconds), 60)
    hours, short = divmod(minutes, 60)
    return f"{hours} h {short:02d} min" if hours else f"{minutes}:{rest:02d}"
