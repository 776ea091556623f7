"""Tables of the exam's report, in Markdown."""

from collections.abc import Iterable, Sequence
from statistics import median

from cell.exam.case import Scattered
from cell.exam.runs.scatter import LEVELS
from cell.exam.scoring.results import Entry
from cell.exam.scoring.statistics import rate
from cell.exam.scoring.targets import by_group, shown, spread_errors


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table of `head` and `rows`."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def scatter_table(entries: Sequence[Entry]) -> str:
    """Rates split by level of scatter and by who moves, and estimated spreads against true ones."""
    groups = {_level(name): [e for e in entries if e.case.scatter == name] for name in LEVELS}
    led = [e for e in entries if e.case.motions == "by_hand"]
    if led:
        groups["standard motions"] = [e for e in entries if e.case.motions == "standard"]
        groups["by hand"] = led
    rows = [(words, *cells) for words, cells in by_group(list(groups.values()))]
    parts = [table(["what", *groups], rows)]
    errors = {name: values for name, values in spread_errors(entries).items() if values}
    if errors:
        rows = [
            (name, str(len(values)), f"{median(values):.2f}", shown(rate(v > 0.0 for v in values)))
            for name, values in errors.items()
        ]
        parts.append("Estimated spread over the true one, at full scatter:")
        parts.append(table(["quantity", "cases", "median", "seen"], rows))
    return "\n\n".join(parts)


def _level(name: Scattered) -> str:
    of = LEVELS[name]
    sizes = f"{1e3 * of.grip:g} mm, {100 * of.damping:g} %, {100 * of.stiffness:g} %"
    return "no scatter" if name == "none" else sizes
