"""Table of a study: one row a group of cases, one column a quantity with its
interval.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from cell.gap.rehearse import table
from cell.record.documents import write_document
from drivers.base.files import replace_file
from tests.lab.studies.campaign import StudyRecord, cost
from tests.lab.studies.study import Figure, Outcome, figure

ALL, TABLE_FILE = "all", "table.md"


@dataclass(frozen=True, slots=True)
class Row:
    """Row of the table: a group of cases, the number of them measured, and their
    statistics.
    """

    group: str
    count: int
    figures: tuple[Figure, ...]


def write_table(kept: StudyRecord) -> Path:
    """Write the table of a study with costs and losses; returns its path.

    A whole study that fits something also writes its data files. Raises OSError where
    the folder cannot be written.
    """
    folder, study = kept.asked.folder, kept.asked.study
    folder.mkdir(parents=True, exist_ok=True)
    for fit in study.fits if len(kept.outcomes) >= kept.asked.count else ():
        found = dict(fit.of(kept.outcomes))
        found["source"] = f"{found.get('source', '')} {progress(kept)}".strip()
        write_document(folder / Path(fit.path).name, found | {"belongs_to": fit.path})
    lost = "".join(f"- {record.key}: {record.reason}\n" for record in kept.lost)
    costs = "".join(f"- {name}: {text}\n" for name, text in cost(kept))
    content = f"{study.question}\n\n{markdown(kept)}\n{costs}{lost}"
    replace_file(folder / TABLE_FILE, content.encode())
    return folder / TABLE_FILE


def rows(kept: StudyRecord) -> tuple[Row, ...]:
    """Rows of a study's table, one a group of cases, and of several groups a last one
    of all.
    """
    quantities, groups = kept.asked.study.quantities, group(kept)
    if len(groups) > 1:
        groups[ALL] = list(kept.outcomes)
    return tuple(
        Row(
            name,
            len(some),
            tuple(figure(q, samples(some, q.value)) for q in quantities),
        )
        for name, some in groups.items()
    )


def group(kept: StudyRecord) -> dict[str, list[Outcome]]:
    """Group outcomes by their values of the study's `by`, in the order of their cases."""
    groups: dict[str, list[Outcome]] = {}
    for outcome in sorted(kept.outcomes, key=lambda o: o.case.number):
        facts = {**outcome.case.values, **outcome.values}
        name = ", ".join(str(facts[key]) for key in kept.asked.study.by) or ALL
        groups.setdefault(name, []).append(outcome)
    return groups


def keeps_bars(found: Sequence[Row]) -> bool:
    """Whether the last row, that of all cases, keeps every bar."""
    return bool(found) and all(f.held is not False for f in found[-1].figures)


def markdown(kept: StudyRecord) -> str:
    """Format the table in Markdown, with the share of cases measured and the command
    for it.
    """
    study = kept.asked.study
    titles = (", ".join(study.by) or "cases", "n", *(q.title for q in study.quantities))
    every = (
        (r.group, str(r.count), *(f.text() for f in r.figures)) for r in rows(kept)
    )
    head, *others = (
        [cell.replace("|", "\\|") for cell in line] for line in (titles, *every)
    )
    return f"{table(head, others)}\n\n{progress(kept)}\n"


def progress(kept: StudyRecord) -> str:
    """Sentence on the number of measured cases, the version of the code, and missing
    cases.
    """
    asked, lost = kept.asked, kept.lost
    done = len(kept.outcomes)
    words = f"{done} of {asked.count} so far" if done < asked.count else f"{done} cases"
    study = asked.study
    again = study.command.format(name=study.name, seed=asked.seed, count=asked.count)
    words += "; 95 % intervals over cases;"
    words += f" `python -m tests.lab {again}`, code and inputs {kept.of}"
    aside = sum(record.state == "set_aside" for record in lost)
    words += f"; {aside} set aside" if aside else ""
    words += f"; {len(lost) - aside} failed" if len(lost) > aside else ""
    return (
        words
        + (f"; {kept.other} records of other code left out" if kept.other else "")
        + "."
    )


def samples(outcomes: Sequence[Outcome], name: str) -> list[list[float]]:
    """Numbers called `name` in each outcome, NaN where missing."""
    found = []
    for outcome in outcomes:
        value = outcome.values.get(name)
        each = value if isinstance(value, list) else [value]
        found.append([float("nan") if one is None else float(one) for one in each])
    return found
