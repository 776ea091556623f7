"""Page of an exam in Markdown: its table, intervals by parameter, and every miss."""

from collections import defaultdict
from collections.abc import Sequence

from cell.gap.rehearse import table
from tests.lab.exam.case import Case
from tests.lab.exam.score import Comparison
from tests.lab.studies.campaign import StudyRecord
from tests.lab.studies.study import (
    Outcome,
    Quantity,
    Statistic,
    Values,
    figure,
    percentage,
)
from tests.lab.studies.table import markdown

GOOD_RESULTS = ("right_strict", "right_class", "correct_no_gap", "correct_abstention")
INTRODUCTION = (
    "Every case is a strip whose plant hides something, or nothing. The workflow sees"
    " the runs and the strip file in a process that is given nothing else; its verdict"
    " is then held against the key. *The model itself* is the rod that the workflow"
    " fits, on a finer grid; *another engine* is a chain of links; *another law* is a"
    " chain in which the effect follows a law that only resembles the library's."
)
COVERED = percentage("covered")
OFF = Quantity("error", Statistic.MEDIAN, "%", 100.0, digits=1)


def page(kept: StudyRecord) -> str:
    """Markdown text of the page of the exam that was `kept`."""
    parts = [
        "# The exam of the gap workflow",
        INTRODUCTION,
        markdown(kept),
        "## Do the intervals hold the truth?",
        parameters(kept.outcomes),
        "## Every miss",
        *(missed(o.values) for o in kept.outcomes if result(o) not in GOOD_RESULTS),
    ]
    return "\n\n".join(parts) + "\n"


def result(outcome: Outcome) -> str:
    """Result of a case, `failed` where there is no verdict."""
    scored = outcome.values["outcome"]
    return str(scored["result"]) if scored else "failed"


def parameters(outcomes: Sequence[Outcome]) -> str:
    """Table of the intervals that hold the truth, and of errors, by parameter [%]."""
    found = defaultdict(list)
    for scored in filter(None, (o.values["outcome"] for o in outcomes)):
        for each in (*scored["base"], *scored["parameters"]):
            found[each["name"]].append(Comparison.model_validate(each))
    rows = []
    for name, some in sorted(found.items()):
        held = figure(COVERED, [[c.covered] for c in some])
        off = figure(OFF, [[c.error] for c in some if c.error is not None])
        rows.append((name, str(len(some)), held.text(), off.text()))
    return table(["parameter", "cases", "held", "median error"], rows)


def missed(values: Values) -> str:
    """Line on a case: what was hidden, and what was said."""
    case, found = Case.model_validate(values["case"]), values["outcome"]
    hidden = [
        f"{name} ({', '.join(f'{k} {v:.3g}' for k, v in amounts.items())})"
        for name, amounts in (case.effects | case.causes).items()
    ]
    what = f"hidden {' and '.join(hidden) or 'nothing'} on {case.strip}"
    line = f"- `{case.name}`: {what}, {case.strength or 'no'} strength;"
    if found is None:
        return f"{line} no verdict: {values['reason']}"
    said = [*found["named"], *map(" or ".join, found["classes"])]
    line += f" gap left {found['realised']:.2f}; said {found['verdict']}"
    stated = found["confidence"]
    sure = "" if stated is None else f", confidence {stated:.2f}"
    return f"{line} ({', '.join(said)}){sure}"
