"""Tables and claims of a benchmark for a terminal."""

from collections.abc import Iterator, Sequence

from cell.benchmark.results import MissingPart, Results
from cell.benchmark.summary import claims, newtons, numeral, rows
from cell.report.words import plural

Table = tuple[Sequence[str], Sequence[Sequence[str]], str]


def claim_lines(results: Results) -> Iterator[str]:
    """Lines on the paper's claims, and on parts that are missing."""
    for claim in claims(results):
        yield f"{'held' if claim.held else 'not held':9}{claim.says}\n           {claim.here}"
    for refused in (r for r in results.results if isinstance(r, MissingPart)):
        yield f"missing  {refused.part}: {refused.reason}"


def tables(results: Results) -> Iterator[Table]:
    """Columns, rows and title of the strips' table, and of that of the paper's range."""
    summary, count = rows(results), len(results.asked.strips)
    strips = [
        (row.policy, f"{s.folded}/{s.of}", numeral(s.mean, signed=True),
         numeral(s.low, signed=True), numeral(s.high, signed=True), numeral(s.worst),
         s.worst_strip, numeral(s.misread), numeral(row.spread))
        for row in summary for s in (row.strips,)
    ]  # fmt: skip
    columns = ("policy", "folds", "mean", "from", "to", "worst", "on", "error", "differ")
    yield (
        columns,
        strips,
        (
            f"{plural(count, 'strip')}, folded through images: displacement in mm "
            "(error: seen − true, at most; differ: folds of one strip, most among them)"
        ),
    )
    side, chain = results.asked.extent.grid, results.asked.extent.chain
    grid = [
        (row.policy, numeral(rod.mean), numeral(rod.quantile_95), numeral(rod.worst),
         str(rod.untouched), numeral(other.mean), numeral(other.worst), newtons(rod.force))
        for row in summary for rod, other in ((row.rod, row.chain),)
    ]  # fmt: skip
    yield (
        ("policy", "mean", "95 %", "worst", "no touch", "chain", "its worst", "force N"),
        grid,
        (
            f"The paper's range, state-based: |d| in mm, {side} x {side} in the rod, "
            f"{chain} x {chain} on the chain"
        ),
    )
