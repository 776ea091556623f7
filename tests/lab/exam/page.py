"""Report of an exam in Markdown, made from the entries of its ledger."""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from statistics import median
from typing import get_args

from cell.gap.rehearse import table
from drivers.base.files import replace_file, writing
from tests.lab.exam.case import Plant, ScatterLevel, Tier
from tests.lab.exam.from_state import LEVELS
from tests.lab.exam.ledger import Entry
from tests.lab.exam.score import Outcome
from tests.lab.exam.targets import (
    Target,
    by_group,
    comparisons,
    outcomes,
    rate,
    rate_text,
    reliable,
    spread_errors,
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
PAIR = {
    "right_strict": "both",
    "right_class": "both",
    "partly": "one of two",
    "wrong_name": "a wrong one",
}


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


def scatter_table(entries: Sequence[Entry]) -> str:
    """Markdown tables of rates by scatter and motion, and of estimated over true
    spreads.
    """
    groups = {
        _scatter_words(name): [e for e in entries if e.case.scatter == name]
        for name in LEVELS
    }
    led = [e for e in entries if e.case.motions == "by_hand"]
    if led:
        groups["standard motions"] = [
            e for e in entries if e.case.motions == "standard"
        ]
        groups["by hand"] = led
    rows = [(words, *cells) for words, cells in by_group(list(groups.values()))]
    parts = [table(["what", *groups], rows)]
    errors = {name: values for name, values in spread_errors(entries).items() if values}
    if errors:
        rows = []
        for name, values in errors.items():
            seen = rate_text(rate(v > 0.0 for v in values))
            rows.append((name, str(len(values)), f"{median(values):.2f}", seen))
        parts.append("Estimated spread over the true one, at full scatter:")
        parts.append(table(["quantity", "cases", "median", "seen"], rows))
    return "\n\n".join(parts)


def _scatter_words(name: ScatterLevel) -> str:
    """Level of run-to-run scatter as text: spreads of grip, damping and stiffness."""
    of = LEVELS[name]
    sizes = f"{1e3 * of.grip:g} mm, {100 * of.damping:g} %, {100 * of.stiffness:g} %"
    return "no scatter" if name == "none" else sizes


def write_report(entries: Sequence[Entry], page: Path, command: str) -> None:
    """Write the Markdown `page`; raises ConfigurationError where that is impossible."""
    with writing(page):
        page.parent.mkdir(parents=True, exist_ok=True)
        replace_file(page, markdown(entries, command).encode())


def by_tier(entries: Iterable[Entry]) -> Iterator[tuple[Tier, list[Entry]]]:
    """Yield every examined tier with its entries."""
    every = list(entries)
    for tier in TIERS:
        mine = [e for e in every if e.case.tier == tier]
        if mine:
            yield tier, mine


def markdown(entries: Sequence[Entry], command: str = "") -> str:
    """Markdown text of the whole page, with the `command` that made the exam."""
    parts = ["# The exam of the gap workflow", INTRODUCTION]
    if command:
        parts.append(f"Made by `{command}`.")
    for tier, mine in by_tier(entries):
        parts += _tier_sections(mine, tier)
    return "\n\n".join(parts) + "\n"


def _tier_sections(entries: Sequence[Entry], tier: Tier) -> Iterator[str]:
    """Headings, texts and tables on one tier, as blocks of Markdown."""
    failed = sum(e.state == "failed" for e in entries)
    engines = ", ".join(sorted({e.of.split("-")[0] for e in entries}))
    yield f"## {TIERS[tier]}"
    yield (
        f"{len(entries)} cases; {failed} of them gave no verdict, and count as not"
        f" right. Source of the engine: {engines}."
    )
    yield _targets_table(targets(entries, tier))
    found = outcomes(entries)
    if found:
        yield "### By what the plant is"
        yield PLANT_KINDS
        yield plant_table(entries)
        yield "### By how much runs differ from one another"
        yield scatter_table(entries)
        yield from _detail_sections(entries, found)
    yield "### Every miss"
    yield "\n".join(_missed_cases(entries)) or "None."


def _detail_sections(
    entries: Sequence[Entry], found: Sequence[Outcome]
) -> Iterator[str]:
    yield "### What was hidden and what was said"
    yield _confusion_table(entries)
    yield "### Is the stated confidence earned?"
    claims = stated_confidences(found)
    yield reliable(claims) if claims else "Nothing was named."
    yield "### Do the intervals hold the truth?"
    yield _coverage_table(entries)


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


def _hidden_causes(entry: Entry) -> str:
    if entry.case.kind == "nothing":
        return "nothing"
    if entry.case.kind == "pair":
        return "two effects"
    return " + ".join(sorted((*entry.case.effects, *entry.case.causes)))


def _verdict_words(entry: Entry) -> str:
    found = entry.outcome
    if found is None:
        return "failed"
    if found.verdict == "ambiguous":
        return (
            "a class with it"
            if found.result in ("right_class", "partly")
            else "a class"
        )
    if found.verdict != "named":
        return found.verdict.replace("_", " ")
    if found.kind == "pair":
        return PAIR.get(found.result, "a wrong one")
    return found.named[0] if len(found.named) == 1 else "several"


def _confusion_table(entries: Iterable[Entry]) -> str:
    """Markdown table of what was said, the most frequent first, for each hidden
    cause.
    """
    said: dict[str, Counter[str]] = {}
    for entry in entries:
        said.setdefault(_hidden_causes(entry), Counter())[_verdict_words(entry)] += 1
    rows = []
    for hidden, answers in sorted(said.items()):
        often = sorted(
            answers.items(), key=lambda item: (-item[1], item[0] not in said, item[0])
        )
        words = ", ".join(f"{answer} {count}" for answer, count in often)
        rows.append((hidden, str(answers.total()), words))
    return table(["hidden", "cases", "said"], rows)


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
    """Answer of a verdict, its confidence, strongest rival and reason, as text."""
    what = ", ".join(found.named) or "; ".join(
        " or ".join(group) for group in found.classes
    )
    words = f"gap left {found.realised:.2f}; said {found.verdict.replace('_', ' ')}"
    words += f" ({what})" if what else ""
    if found.confidence is not None:
        words += f", confidence {found.confidence:.2f}"
    if found.rival:
        words += f"; strongest rival {found.rival}"
    return words + (f"; {found.reason}" if found.reason else "")
