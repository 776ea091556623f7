"""Prints the tables of a benchmark in the terminal."""

from collections.abc import Sequence

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from cell.benchmark.results import MissingPart, Results
from cell.benchmark.summary import Row, claims, newtons, numeral, rows
from cell.report.words import plural


def show(results: Results, console: Console) -> None:
    """Print the tables and the claims of `results`."""
    summary = rows(results)
    console.print(_strips_table(summary, len(results.asked.strips)))
    console.print(_range_table(summary, results))
    for claim in claims(results):
        mark = "[green]held[/]    " if claim.held else "[red]not held[/]"
        console.print(f"  {mark} {claim.says}\n           {claim.here}", highlight=False)
    for refused in (r for r in results.results if isinstance(r, MissingPart)):
        reason = escape(refused.reason)
        console.print(f"  [yellow]missing[/]  {refused.part}: {reason}", highlight=False)


def _strips_table(summary: Sequence[Row], count: int) -> Table:
    table = Table(
        box=SIMPLE_HEAD,
        pad_edge=False,
        padding=(0, 1, 0, 0),
        title=f"{plural(count, 'strip')}, folded through images: displacement in mm",
        caption="error: seen − true, at most; differ: folds of one strip, most among them",
    )
    table.add_column("policy", no_wrap=True)
    for name in ("folds", "mean", "from", "to", "worst"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("on", no_wrap=True)
    for name in ("error", "differ"):
        table.add_column(name, justify="right", no_wrap=True)
    for row in summary:
        s = row.strips
        numbers = [numeral(s.mean, signed=True), numeral(s.low, signed=True)]
        numbers += [numeral(s.high, signed=True), numeral(s.worst)]
        table.add_row(row.policy, f"{s.folded}/{s.of}", *numbers, s.worst_strip,
                      numeral(s.misread), numeral(row.spread))  # fmt: skip
    return table


def _range_table(summary: Sequence[Row], results: Results) -> Table:
    side, chain = results.asked.extent.grid, results.asked.extent.chain
    title = f"The paper's range, state-based: |d| in mm, {side} x {side} in the rod, "
    table = Table(box=SIMPLE_HEAD, pad_edge=False, title=f"{title}{chain} x {chain} on the chain")
    table.add_column("policy", no_wrap=True)
    for name in ("mean", "95 %", "worst", "no touch", "chain", "worst", "force N"):
        table.add_column(name, justify="right")
    for row in summary:
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
