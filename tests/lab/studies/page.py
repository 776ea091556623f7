"""The page of a study: its question, table, the cases as points, cost, and failures."""

from pathlib import Path

import numpy as np

from cell.campaign.progress import clock
from cell.record.documents import write_document
from cell.report.drawing import BLUE, INK, as_svg, canvas
from cell.report.kit import Tone, page
from cell.report.verdict import Verdict
from drivers.files import replace_file
from tests.lab.studies.campaign import StudyRecord, cost
from tests.lab.studies.table import (
    cells,
    group,
    head,
    keeps_bars,
    markdown,
    progress,
    rows,
    samples,
)

TABLE_FILE, PAGE = "table.md", "study.html"
ROW_HEIGHT, PAGE_WIDTH = 0.32, 8.4  # inch


def write_page(kept: StudyRecord) -> Path:
    """Write the page, table and ledger of a study; returns the page's path.

    A whole study that fits something also writes its data files. Raises OSError where the folder
    cannot be written.
    """
    folder, study = kept.asked.folder, kept.asked.study
    folder.mkdir(parents=True, exist_ok=True)
    replace_file(folder / TABLE_FILE, markdown(kept).encode())
    for fit in study.fits if len(kept.outcomes) >= kept.asked.count else ():
        found = dict(fit.of(kept.outcomes))
        found["source"] = f"{found.get('source', '')} {progress(kept)}".strip()
        write_document(folder / Path(fit.path).name, found | {"belongs_to": fit.path})
    if study.ledger is not None:
        text = f"{study.ledger.of(kept.outcomes)}\n{progress(kept)}\n"
        replace_file(folder / Path(study.ledger.path).name, text.encode())
    path = folder / PAGE
    replace_file(path, page_of(kept).encode())
    return path


def page_of(kept: StudyRecord) -> str:
    """Self-contained HTML page of a study."""
    study, found = kept.asked.study, rows(kept)
    whole = len(kept.outcomes) >= kept.asked.count
    tone: Tone = "fair" if not whole else "good" if keeps_bars(found) else "bad"
    bars = [q for q in study.quantities if q.bar is not None]
    headline = "Its bars are kept" if keeps_bars(found) else "A bar is not kept"
    return page(
        "campaign/study.html",
        f"Study: {study.name}",
        name=study.name,
        said=Verdict(
            tone if bars else "fair",
            headline if bars and found else "What was measured",
            (study.question, progress(kept)),
        ),
        head=head(kept),
        rows=[cells(row) for row in found],
        points=points(kept) if kept.outcomes else "",
        lost=[(r.key, r.reason) for r in kept.lost],
        cost=cost(kept, clock),
    )


def points(kept: StudyRecord) -> str:
    """Figure (SVG) of the first quantity of every case, a row for each group."""
    quantity, groups = kept.asked.study.quantities[0], group(kept)
    with canvas(PAGE_WIDTH, 0.7 + ROW_HEIGHT * len(groups)) as figure:
        axes = figure.add_subplot()
        for row, (name, outcomes) in enumerate(groups.items()):
            values = quantity.scale * np.concatenate(samples(outcomes, quantity.value))
            places = np.full(len(values), row)
            axes.plot(values, places, "o", ms=4, alpha=0.5, color=BLUE, mec=BLUE, gid=name)
        axes.axvline(0.0, color=INK, lw=0.8)
        axes.set_yticks(range(len(groups)), list(groups))
        axes.set_ylim(len(groups) - 0.5, -0.5)
        axes.set_xlabel(f"{quantity.value.replace('_', ' ')}  [{quantity.unit}]")
        return as_svg(figure)
