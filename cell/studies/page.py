"""HTML page of a benchmark: figures of its results, beside the published numbers."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from cell.record.documents import plain
from cell.report.drawing import as_png
from cell.report.html import Tone, page
from cell.report.page_verdict import PageVerdict
from cell.report.words import NO_VALUE, millimetres
from cell.studies import figures
from cell.studies.results import MissingPart, Results, displacements
from cell.studies.summary import (
    PAPER_POLICIES,
    PAPER_WORST,
    claims,
    misses_text,
    numeral,
    rows,
)
from drivers.base.files import write_file
from drivers.base.outputs import write_output

DPI = 160
TITLE = "Feedback-based fabric strip folding, from simulation"
NOT_IN_SOURCE = "Of the paper, the numbers that its text states are drawn."


def write_results(results: Results, folder: Path) -> Path:
    """Write benchmark.json and benchmark.html into `folder`; returns the page's
    path.
    """
    write_file(
        folder / "benchmark.json", results.model_dump_json(by_alias=True, indent=1)
    )
    page = folder / "benchmark.html"
    write_file(page, page_of(results))
    return page


def write_main_picture(results: Results, path: Path) -> None:
    """Draw the displacements on all strips as a PNG file at `path`."""
    from matplotlib import rc_context

    with rc_context({"svg.fonttype": "path"}):
        write_output(path, as_png(figures.main_picture(results), DPI))


def lines(results: Results) -> list[dict[str, Any]]:
    """JSON objects of the results: one for each policy, then one a claim; None if
    unknown.
    """
    summary = [{"kind": "policy", **asdict(row)} for row in rows(results)]
    claimed = [{"kind": "claim", **asdict(claim)} for claim in claims(results)]
    return [plain(line) for line in (*summary, *claimed)]


def page_of(results: Results) -> str:
    """Self-contained HTML page of `results`."""
    summary = rows(results)
    strips = []
    for row in summary:
        edges_apart = numeral(row.strips.offset), numeral(row.strips.worst_offset)
        strips.append((*row.strip_cells(), *edges_apart))
    asked = results.asked
    made_with = {"speed": f"{results.speed:g} m/s", "seed": str(asked.seed)}
    made_with |= {"strips": ", ".join(asked.strips)} | results.made_with
    made_with.pop("weights", None)
    missing = [result for result in results.results if isinstance(result, MissingPart)]
    return page(
        "studies/benchmark.html",
        TITLE,
        version=results.made_with.get("cell", ""),
        said=verdict_of(results),
        claims=[
            ("held" if c.held else "not held", c.says, c.here) for c in claims(results)
        ],
        asked=asked,
        strips=strips,
        ranges=[row.range_cells() for row in summary],
        outside=_outside_range(results),
        hidden=_hidden_effects(results),
        figures={name: draw(results) for name, draw in FIGURES.items()},
        refused=[(part.part, part.reason) for part in missing],
        made_with=made_with.items(),
    )


def verdict_of(results: Results) -> PageVerdict:
    """Verdict on the published claim that feedback folds every strip to under
    PAPER_WORST [m].
    """
    limit = f"{1e3 * PAPER_WORST['feedback']:.0f} mm"
    row = next((row for row in rows(results) if row.policy == "feedback"), None)
    if row is None or row.strips.folded == 0:
        said = "It is made of the policy `feedback`, which folded no strip here."
        return PageVerdict("fair", "The paper's claim was not tried", (said,))
    main = next(claims(results))
    strips = row.strips
    headline = f"Under {limit} on every strip: {'held' if main.held else 'not held'}"
    sentences = (
        (
            f"Feedback folded {strips.folded} of {strips.of} strips through rendered"
            f" images: {main.here}, in the mean"
            f" {millimetres(strips.mean, signed=True)}."
        ),
        f"The camera was at most {millimetres(strips.misread)} off the twin's truth.",
        NOT_IN_SOURCE,
    )
    tone: Tone = "good" if main.held else "bad"
    return PageVerdict(
        tone, headline, sentences, millimetres(strips.worst), "worst |d|, feedback"
    )


def _outside_range(results: Results) -> str:
    """Text that counts, for each published policy, the strips whose d left its
    simulated range.
    """
    texts = []
    for policy in PAPER_POLICIES:
        seen = displacements(results.folds(policy))
        seen = seen[np.isfinite(seen)]
        simulated = results.over_range(policy, "rod")
        if (
            simulated is None
            or seen.size == 0
            or np.isnan(simulated.displacement_grid).all()
        ):
            continue
        below = seen < np.nanmin(simulated.displacement_grid)
        above = seen > np.nanmax(simulated.displacement_grid)
        texts.append(f"{policy} {np.sum(below | above)} of {seen.size}")
    return "; ".join(texts) or NO_VALUE


def _hidden_effects(results: Results) -> dict[str, Any]:
    """Table of misses with effects unknown to the policies: rows by effect, columns by
    policy.
    """
    policies = [
        policy for policy in results.asked.policies if results.hidden_folds(policy)
    ]
    found = {
        (r.policy, r.effect): misses_text(r)
        for p in policies
        for r in results.hidden_folds(p)
    }
    effects = dict.fromkeys(effect for _, effect in found)
    misses = [
        (
            effect.replace("_", " ") or "none",
            *(found.get((p, effect), NO_VALUE) for p in policies),
        )
        for effect in effects
    ]
    return {"head": ("hidden", *policies), "rows": misses}


FIGURES = {
    "strips": figures.strips_figure,
    "repeats": figures.repeats_figure,
    "range": figures.range_figure,
    "maps": figures.maps_figure,
    "force": figures.force_figure,
}
