"""Report of an exam in Markdown, made from the entries of its ledger."""

from collections.abc import Iterable, Iterator, Sequence
from statistics import median
from typing import get_args

from cell.gap.rehearse import table
from tests.lab.exam.case import Plant, Tier
from tests.lab.exam.run import Entry
from tests.lab.exam.score import Outcome
from tests.lab.exam.targets import (
    Target,
    by_group,
    comparisons,
    outcomes,
    rate,
    rate_text,
    reliable,
    targets,
)

GOOD_RESULTS = ("right_strict", "right_class", "correct_no_gap", "correct_abstention")
TIERS: dict[Tier, str] = {
    "state": "From the state, without images",
    "images": "Through images",
}
PLANTS = get_args(Plant)
INTRODUCTION = (
    "Every case is a strip whose plant hides something, or nothing. The workflow sees"
    " the runs and the strip file in a process that is given nothing else; its verdict"
    " is then held against the key. Rates are given with their 95 % intervals (Wilson)."
)
PLANT_KINDS = (
    "*The model itself* is the rod that the workflow fits, on a finer grid; *another "
    "engine* is a chain of links; *another law* is a chain in which the effect follows "
    "a law that only resembles the library's."
)


def plant_table(entries: Sequence[Entry]) -> str:
    """Markdown table of rates by kind of plant, with right names beside the stated
    confidence.
    """
    groups = {name: [e for e in entries if e.case.plant == name] for name in PLANTS}
    groups = {name: mine for name, mine in groups.items() if mine}
    rows = [(words, *cells) for words, cells in by_group(list(groups.values()))]
    earned = [
        _reliability_line(stated_confidences(outcomes(mine)))
        for mine in groups.values()
    ]
    return table(["what", *groups], [*rows, ("names: right against stated", *earned)])


def _reliability_line(claims: Sequence[tuple[float, bool]]) -> str:
    """Rate of right names in `claims`, and their mean stated confidence, as text."""
    if not claims:
        return "no name"
    right = rate_text(rate(right for _, right in claims))
    return f"{right}, stated {sum(c for c, _ in claims) / len(claims):.2f}"


def markdown(entries: Sequence[Entry], command: str) -> str:
    """Markdown text of the page of an exam that the `command` made."""
    parts = ["# The exam of the gap workflow", INTRODUCTION, f"Made by `{command}`."]
    for tier in dict.fromkeys(entry.case.tier for entry in entries):
        mine = [entry for entry in entries if entry.case.tier == tier]
        parts += _tier_sections(mine, tier)
    return "\n\n".join(parts) + "\n"


def _tier_sections(entries: Sequence[Entry], tier: Tier) -> Iterator[str]:
    """Headings, texts and tables on one tier, as blocks of Markdown."""
    found = outcomes(entries)
    yield f"## {TIERS[tier]}"
    yield (
        f"{len(entries)} cases; {len(entries) - len(found)} of them gave no verdict,"
        " and count as not right."
    )
    yield _targets_table(targets(entries, tier))
    yield "### By what the plant is"
    yield PLANT_KINDS
    yield plant_table(entries)
    yield "### Is the stated confidence earned?"
    claims = stated_confidences(found)
    yield reliable(claims) if claims else "Nothing was named."
    yield "### Do the intervals hold the truth?"
    yield _coverage_table(entries)
    yield "### Every miss"
    yield "\n".join(_missed_cases(entries)) or "None."


def _targets_table(lines: Iterable[Target]) -> str:
    words = {True: "met", False: "**missed**", None: ""}
    rows = [
        (
            line.words,
            line.found,
            line.wanted,
            "too few cases" if line.few else words[line.met],
        )
        for line in lines
    ]
    return table(["what", "found", "wanted", ""], rows)


def stated_confidences(found: Iterable[Outcome]) -> list[tuple[float, bool]]:
    """Stated confidence of every verdict that names an effect, and whether the name is
    right.
    """
    return [(o.confidence, o.right) for o in found if o.confidence is not None]


def _coverage_table(entries: Sequence[Entry]) -> str:
    every = comparisons(entries)
    right = [e for e in entries if e.outcome and e.outcome.result in GOOD_RESULTS]
    if not every:
        return "No parameter can be compared: no laws agree."
    rows = [
        ("all", rate_text(rate(c.covered for c in every)), ""),
        (
            "all, of right verdicts",
            rate_text(rate(c.covered for c in comparisons(right))),
            "",
        ),
    ]
    for name in sorted({c.name for c in every}):
        mine = [c for c in every if c.name == name]
        errors = [c.error for c in mine if c.error is not None]
        middle = f"{100 * median(errors):.1f} %" if errors else ""
        rows.append((name, rate_text(rate(c.covered for c in mine)), middle))
    return table(["parameter", "held", "median error"], rows)


def _missed_cases(entries: Iterable[Entry]) -> Iterator[str]:
    for entry in entries:
        found = entry.outcome
        if found is None:
            yield (
                f"- `{entry.case.name}`: {_hidden_words(entry)}; no verdict:"
                f" {entry.reason}"
            )
        elif found.result not in GOOD_RESULTS:
            yield (
                f"- `{entry.case.name}`: {_hidden_words(entry)}; {_stated_words(found)}"
            )


def _hidden_words(entry: Entry) -> str:
    """Hidden effects of an entry with their values, the strip and the strength, as
    text.
    """
    case = entry.case
    names = [
        f"{name} ({', '.join(f'{k} {v:.3g}' for k, v in values.items())})"
        for name, values in (case.effects | case.causes).items()
    ]
    strength = f", {case.strength}" if case.strength else ""
    return f"hidden {' and '.join(names) or 'nothing'} on {case.strip}{strength}"


def _stated_words(found: Outcome) -> str:
    """Answer of a verdict and its confidence, as text."""
    what = [*found.named, *map(" or ".join, found.classes)]
    words = f"gap left {found.realised:.2f}; said {found.verdict.replace('_', ' ')}"
    words += f" ({', '.join(what)})" if what else ""
    stated = found.confidence
    return words if stated is None else f"{words}, confidence {stated:.2f}"
