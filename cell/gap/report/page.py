"""Report page of a fit, `report.html`, self-contained and for a technician."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from cell.gap.diagnosis import held_out_gap
from cell.gap.fitting.base_fit import undetermined_values
from cell.gap.report import figures
from cell.gap.report.sentence import (
    capitalised,
    detection_limit,
    deviation_text,
    headline,
    in_small_unit,
    interval_text,
    motion_name,
    number_text,
    percent,
    probability_text,
    quantity_label,
    scatter_rows,
    sentence,
    shown_unit,
    undetectable_effects,
    usual_size,
)
from cell.gap.selection.likelihood import MIN_GAIN
from cell.gap.subject.subject import Run
from cell.gap.verdict.compose import SIGNIFICANT
from cell.gap.verdict.findings import Findings
from cell.gap.verdict.offered_law import OfferedLaw
from cell.gap.verdict.schema import CandidateEntry, Gap, Kind, Verdict
from cell.report.html import Tone, page as document
from cell.report.page_verdict import PageVerdict as Card
from cell.report.words import NO_VALUE, millimetres
from drivers.base.errors import CellError
from drivers.base.settings import parse
from drivers.strip.file import StripFile
from policies.planned import fold_by_plan

LISTED_EXPERIMENTS = 5  # runs of which the page advises
TONES: dict[Kind, Tone] = {
    "named": "good",
    "no_gap": "good",
    "ambiguous": "fair",
    "unexplained": "bad",
}


def place_values(findings: Findings) -> dict[str, str]:
    """Template values on bins where the refitted base deviates beyond noise: `words`,
    `map`.
    """
    places = findings.places
    strong = [place for place in places if place.p < SIGNIFICANT]
    if not strong:
        return {
            "words": "Nowhere beyond what noise does.",
            "map": figures.heat_map(places),
        }
    first = strong[0]
    words = (
        f"Strongest in {first.channel}, {first.zone} zone, {first.phase} phase of"
        f" {motion_name(first.condition)}: {abs(first.z):.0f} sigma. {len(strong)} of"
        f" {len(places)} places disagree beyond noise (dots; family-wise 5 %). Shown is"
        " the model after its base parameters were refitted."
    )
    return {"words": words, "map": figures.heat_map(places)}


def candidate_values(findings: Findings, verdict: Verdict) -> dict[str, Any]:
    """Template values on all fitted models, with their gain [nats] on left-out runs."""
    accepted = findings.accepted.model.name
    note = (
        "What each effect gains in predicting runs that the fit had not seen, in nats."
        " Accepted is the most probable set of effects that predicts better than each"
        f" of its subsets, beyond errors of laws, and leads each by {MIN_GAIN:.0f} nats"
        " or more (55 times as probable)."
    )
    return {
        "note": note,
        "found": bool(findings.accepted.model.effects),
        "dead": ", ".join(p.candidate.name for p in findings.screen.probed if p.dead),
        "rows": [
            _candidate_row(row, row.name == accepted) for row in verdict.candidates
        ],
    }


def _candidate_row(row: CandidateEntry, best: bool) -> dict[str, Any]:
    """Template values on one candidate: name, gain, standard error, p-value,
    parameters.
    """
    scatter = f"{row.se:.1f}" if row.se else NO_VALUE  # none where it was only screened
    return {
        "name": row.name,
        "best": best,
        "numbers": (f"{row.elpd_gain:.1f}", scatter, probability_text(row.p)),
        "parameters": [
            f"{name} {interval_text(value)}" for name, value in row.parameters.items()
        ],
    }


def base_values(findings: Findings, verdict: Verdict) -> dict[str, Any]:
    """Template values on the base model: rows of stated and refitted parameters, and a
    note.
    """
    weak = ", ".join(p.name for p, _ in undetermined_values(findings.base.estimate))
    note = f"The runs add little to what was known before of: {weak}."
    rows = []
    for p in findings.subject.scope.base:
        value = verdict.base[p.name]
        values = (p.start, value.value, value.low, value.high)
        start, refitted, *ends = (
            number_text(in_small_unit(v, p.unit), 4) for v in values if v is not None
        )
        within = " to ".join(ends) if len(ends) == 2 else ""
        rows.append((p.name, start, refitted, within, shown_unit(p.unit)))
    return {
        "rows": rows,
        "note": note if weak else "The runs at least halve what was uncertain of each.",
    }


def held_out_values(findings: Findings, verdict: Verdict) -> dict[str, Any]:
    """Template values on held-out runs, before and after: figures, a sentence, a
    table.
    """
    fits = findings.held_out_fits.by_key
    names = conditions(fits["before"].evidence.runs)
    by_run = {
        word: held_out_gap.excess(held_out_gap.run_squares(fit)[:, None])
        for word, fit in fits.items()
    }
    typical = int(np.argsort(by_run["before"])[len(names) // 2])
    drawn = {word: fit.on([typical]) for word, fit in fits.items()}
    (run,) = figures.replay_runs(findings.subject, drawn, held_out=True)
    return {
        "typical": names[typical],
        "midlines": figures.midlines(run),
        "traces": figures.residual_traces(
            fits, typical, findings.subject.scope.quantities
        ),
        "head": ("rms", *fits, "noise", "sigma beyond"),
        "rows": list(_held_out_rows(findings, verdict.gap)),
        "leaves": any(excess.any() for excess in by_run.values()),
        "bars": figures.run_bars(names, by_run) if len(names) > 1 else "",
    }


def _held_out_rows(findings: Findings, gap: Gap) -> Iterator[tuple[str, ...]]:
    """Rows by quantity: rms of each fit to held-out runs, noise, excess of each fit
    [noise].
    """
    quantities = findings.subject.scope.quantities
    fits = findings.held_out_fits.by_key
    sides = [*(getattr(gap, word) for word in fits), gap.floor]
    beyond = [held_out_gap.excess_by_quantity(fit, quantities) for fit in fits.values()]
    words = {q.key: f"{quantity_label(q)} [{q.unit}]" for q in quantities.values()}
    for key in (key for key in beyond[0] if key in gap.before):
        rms = (f"{side[key]:.3g}" for side in sides)
        yield words[key], *rms, " then ".join(f"{side[key]:.2g}" for side in beyond)


def conditions(runs: Sequence[Run]) -> list[str]:
    """Short names of `runs` by their motion, such as `fast`, with numbers for
    repeats.
    """
    short = [motion_name(run.condition) for run in runs]
    return [
        name if short.count(name) == 1 else f"{name} {short[: i + 1].count(name)}"
        for i, name in enumerate(short)
    ]


def remaining_values(findings: Findings, verdict: Verdict) -> dict[str, Any]:
    """Template values on the residual that the accepted model leaves, and detection
    limits.
    """
    sentences = {each.name: each.sentence for each in findings.subject.scope.candidates}
    rest = verdict.unexplained
    is_open = verdict.verdict == "unexplained"  # then the card describes it
    return {
        "open": is_open,
        "rest": capitalised(rest.description) if rest and not is_open else "",
        "law": _law_text(findings.law) if findings.law is not None else "",
        "alike": "; ".join(" or ".join(group) for group in verdict.ambiguous),
        "untested": [(each.what, each.why) for each in verdict.untested],
        "silent": ", ".join(undetectable_effects(findings)),
        "detectable": [
            (
                name,
                detection_limit(findings, name, value),
                usual_size(findings, name),
                sentences[name],
            )
            for name, value in sorted(verdict.detectable.items())
        ],
    }


def _law_text(law: OfferedLaw) -> str:
    """Sentence on the law that is offered, and the share of the gap that it closes."""
    closed = percent(law.shrink)
    return (
        f"A law describes it, without a name: {law.words}. It closes {closed} of the"
        " gap on held-out runs."
    )


def page(findings: Findings, verdict: Verdict) -> str:
    """HTML text of a fit's report: the verdict card, figures, and below them all
    numbers.
    """
    runs, held = len(findings.subject.runs), len(verdict.held_out)
    name = findings.subject.name
    return document(
        "gap/report/gap.html",
        f"{name}: simulation and measurement",
        title=(
            f"{name}: simulation against {runs} measured runs, {held} of them held out"
        ),
        name=name,
        said=_verdict_card(findings, verdict),
        following=[f"{capitalised(step.sentence)}." for step in verdict.steps],
        notes=verdict.notes,
        planned=_planned_folds(findings, verdict),
        held=held_out_values(findings, verdict),
        where=place_values(findings),
        remains=remaining_values(findings, verdict),
        repeats=_scatter_table(findings),
        experiments=_experiments_table(verdict),
        candidates=candidate_values(findings, verdict),
        base=base_values(findings, verdict),
        foot=_provenance(findings, verdict),
    )


def _planned_folds(findings: Findings, verdict: Verdict) -> dict[str, Any]:
    """Template values on folds of the accepted strip, planned without and with its
    patch.

    Empty for mechanisms, where nothing was accepted, and where the rod cannot simulate
    the strip.
    """
    if findings.subject.kind != "strip" or not verdict.effects:
        return {"rows": [], "figure": ""}
    values = verdict.values_with(verdict.effects)
    patches = (findings.subject.patch(*each, "") for each in (({}, {}), values))
    try:
        stated, accepted = (parse(patch, StripFile, "patch") for patch, _ in patches)
        drawn = {
            "planned from the file": fold_by_plan(stated, accepted),
            "planned with what was found": fold_by_plan(accepted, accepted),
        }
    except CellError:
        return {"rows": [], "figure": ""}
    rows = [(name, millimetres(d, signed=True)) for name, (d, _) in drawn.items()]
    return {
        "rows": rows,
        "figure": figures.folds({n: shape for n, (_, shape) in drawn.items()}),
    }


def _verdict_card(findings: Findings, verdict: Verdict) -> Card:
    """Verdict card: headline, sentences, tone, and the probability in large print."""
    least = min((effect.confidence for effect in verdict.effects), default=None)
    number = "" if least is None else percent(least)
    below = (
        ""
        if least is None
        else "probable; causes outside\nthe library count against it"
    )
    lines = [sentence(findings, verdict)]
    if findings.held_out_fits.changed:
        lines.append(capitalised(verdict.held_out_sentence) + ".")
    tone = TONES[verdict.verdict]
    if verdict.deviates:
        tone = "bad" if tone == "bad" else "fair"
        lines = [capitalised(deviation_text(verdict.deviates)) + ".", *lines]
    return Card(tone, headline(verdict), tuple(lines), number, below)


def _scatter_table(findings: Findings) -> list[tuple[str, ...]] | None:
    """Rows on quantities that differ from run to run; None for a subject without
    any.
    """
    if not any(p.random for run in findings.subject.runs for p in run.local):
        return None
    return scatter_rows(findings.model_tests.scatter, findings.subject.scope.scatter)


def _experiments_table(verdict: Verdict) -> list[tuple[str, ...]] | None:
    """Rows (run, separated models, sigma, minutes) of advised runs; None where
    decided.
    """
    if verdict.verdict in ("named", "no_gap") and not verdict.ambiguous:
        return None
    return [
        (
            advised.experiment,
            " from ".join(advised.separates),
            f"{advised.expected_sigma:.1f}",
            f"{advised.minutes:.1f}",
        )
        for advised in verdict.advice[:LISTED_EXPERIMENTS]
    ]


def _provenance(findings: Findings, verdict: Verdict) -> str:
    held = [run for run in findings.subject.runs if run.name in verdict.held_out]
    return (
        f"{verdict.simulations} simulated runs in {verdict.runtime:.0f} s. "
        f"Held out: {', '.join(conditions(held))}."
    )
