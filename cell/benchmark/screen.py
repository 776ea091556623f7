"""A benchmark in the terminal: progress while it runs, tables at its end."""

from collections.abc import Sequence

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeRemainingColumn
from rich.table import Table

from cell.benchmark.claims import claims
from cell.benchmark.numbers import newtons, numeral
from cell.benchmark.parts.part import Part
from cell.benchmark.results import ImageFold, Refused, Result, Results
from cell.benchmark.summary import Row, rows
from cell.report.words import millimetres


class Meter:
    """A progress bar weighted by the parts' cost; without a terminal, one line for each part."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._count = self._done = 0
        self._bar = Progress(
            BarColumn(bar_width=28),
            TextColumn("{task.percentage:3.0f} %"),
            TimeRemainingColumn(compact=True),
            TextColumn("{task.description}"),
            console=console,
        )
        self._task: TaskID | None = None

    def begin(self, parts: Sequence[Part], known: Sequence[Part]) -> None:
        """Show the initial progress."""
        self._count, self._done = len(parts), len(known)
        if known:
            self._console.print(f"{len(known)} of {len(parts)} parts are known already")
        if self._console.is_terminal and len(known) < len(parts):
            done = sum(part.cost for part in known)
            self._task = self._bar.add_task("", total=sum(p.cost for p in parts))
            self._bar.update(self._task, completed=done)
            self._bar.start()

    def finished(self, part: Part, result: Result) -> None:
        """Advance; a refused part stays on the screen."""
        self._done += 1
        told = f"{self._done}/{self._count}  {part.key}{_said(result)}"
        if self._task is None:
            self._console.print(told, highlight=False, soft_wrap=True)
            return
        if isinstance(result, Refused):
            self._console.print(told, style="yellow", highlight=False, markup=False)
        self._bar.update(self._task, advance=part.cost, description=told)

    def close(self) -> None:
        """Remove the bar."""
        self._bar.stop()


def show(results: Results, console: Console) -> None:
    """Print the tables and the claims."""
    told = rows(results)
    console.print(_strips_table(told, len(results.asked.strips)))
    console.print(_range_table(told, results))
    for claim in claims(results):
        mark = "[green]held[/]    " if claim.held else "[red]not held[/]"
        console.print(f"  {mark} {claim.says}\n           {claim.here}", highlight=False)
    for refused in (r for r in results.results if isinstance(r, Refused)):
        reason = escape(refused.reason)
        console.print(f"  [yellow]missing[/]  {refused.part}: {reason}", highlight=False)


def _strips_table(told: Sequence[Row], count: int) -> Table:
    table = Table(
        box=SIMPLE_HEAD,
        pad_edge=False,
        padding=(0, 1, 0, 0),
        title=f"{count} strip{_s(count)}, folded through images: displacement in mm",
        caption="error: seen − true, at most; differ: folds of one strip, most among them",
    )
    table.add_column("policy", no_wrap=True)
    for name in ("folds", "mean", "from", "to", "worst"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("on", no_wrap=True)
    for name in ("error", "differ"):
        table.add_column(name, justify="right", no_wrap=True)
    for row in told:
        s = row.strips
        numbers = [numeral(s.mean, signed=True), numeral(s.low, signed=True)]
        numbers += [numeral(s.high, signed=True), numeral(s.worst)]
        table.add_row(row.policy, f"{s.folded}/{s.of}", *numbers, s.worst_strip,
                      numeral(s.misread), numeral(row.spread))  # fmt: skip
    return table


def _range_table(told: Sequence[Row], results: Results) -> Table:
    side, chain = results.asked.extent.grid, results.asked.extent.chain
    title = f"The paper's range, state-based: |d| in mm, {side} x {side} in the rod, "
    table = Table(box=SIMPLE_HEAD, pad_edge=False, title=f"{title}{chain} x {chain} on the chain")
    table.add_column("policy", no_wrap=True)
    for name in ("mean", "95 %", "worst", "no touch", "chain", "worst", "force N"):
        table.add_column(name, justify="right")
    for row in told:
        rod, other = row.rod, row.chain
        table.add_row(
            row.policy,
            numeral(rod.mean),
            numeral(rod.quantile_95),
            numeral(rod.worst),
            str(rod.untouched),
            numeral(other.mean),
            numeral(other.worst),
            newtons(rod.force),
        )
    return table


def _said(result: Result) -> str:
    if isinstance(result, Refused):
        return f": {result.reason}"
    if isinstance(result, ImageFold):
        return f": {millimetres(result.displacement, signed=True)}"
    return ""


def _s(count: int) -> str:
    return "" if count == 1 else "s"
