"""Evidence of the report: where model and runs disagree, the candidates, the refitted base."""

from collections.abc import Sequence
from typing import Any

from cell.gap.report import figures
from cell.gap.report.sentence import motion
from cell.gap.report.units import in_small_unit, interval, number, probability, unit
from cell.gap.selection.likelihood import MIN_GAIN
from cell.gap.subject.subject import Parameter
from cell.gap.verdict.compose import LISTED
from cell.gap.verdict.findings import Findings
from cell.gap.verdict.schema import Compared, Interval, Verdict

LISTED_SETS = 4  # sets of effects of which the page speaks
EXCLUDED = 1e-4  # probability below which a set counts as excluded: its size says nothing


def where(found: Findings) -> dict[str, str]:
    """A sentence and a map of the places where the refitted base deviates beyond noise."""
    return {"words": _where(found), "map": figures.heat_map(found.places)}


def _where(found: Findings) -> str:
    """Text on the strongest place of disagreement, and how many exceed the noise."""
    places = found.places
    strong = [place for place in places if place.p < LISTED.significance]
    if not strong:
        return "Nowhere beyond what noise does."
    first = strong[0]
    text = (
        f"Strongest in {first.channel}, {first.zone} zone, {first.phase} phase of "
        f"{motion(first.condition)}: {abs(first.z):.0f} sigma. {len(strong)} of {len(places)} "
        "places disagree beyond noise (dots; family-wise 5 %). Shown is the model after its base "
        "parameters were refitted."
    )
    alone = sum(place.p < LISTED.significance for place in found.fitted.places)
    if found.judged.places and alone < len(strong):
        text += (
            f" By itself {alone or 'none'} of them would stand out from noise and from what "
            f"differs from run to run; the others are where what is left goes the way of "
            f"{found.accepted.model.name}."
        )
    return text


def candidates(found: Findings, verdict: Verdict) -> dict[str, Any]:
    """Template values on all fitted models, with their gain on runs left out."""
    accepted = found.accepted.model.name
    note = (
        "What each effect gains in predicting runs that the fit had not seen, in nats. Taken is "
        "the most probable set of effects that predicts better than each fitted part of it, and "
        f"leads it by {MIN_GAIN:.0f} nats or more (55 times as probable)."
    )
    return {
        "note": note,
        "bars": figures.candidate_bars(verdict.candidates, accepted) if verdict.candidates else "",
        "leads": _leads(found),
        "probable": _probable_sets(verdict),
        "dead": ", ".join(p.candidate.name for p in found.screened.probed if p.dead),
        "rows": [_candidate_row(row, row.name == accepted) for row in verdict.candidates],
    }


def _probable_sets(verdict: Verdict) -> str:
    """Sentence on the most probable sets of effects."""
    if verdict.posterior is None or len(verdict.posterior.models) < 2:
        return ""
    first, *others = verdict.posterior.models[:LISTED_SETS]
    others = [m for m in others if m.p > EXCLUDED]
    listed = [f"{_effect_names(m.names)} {probability(m.p)}" for m in others]
    also = f"; besides {', '.join(listed)}" if listed else "; all others are excluded"
    return (
        f"Of the sets of effects that were fitted, by their evidence: {_effect_names(first.names)} "
        f"{number(first.p, 2)}{also}. On held-out runs {number(verdict.posterior.left, 2)} times "
        "noise and floor are left. A cause outside the library is not among them."
    )


def _effect_names(names: Sequence[str]) -> str:
    return " + ".join(names) or "the base alone"


def _candidate_row(row: Compared, best: bool) -> dict[str, Any]:
    same = "" if row.invariance_p is None else probability(row.invariance_p)
    return {
        "name": row.name,
        "best": best,
        "numbers": (f"{row.elpd_gain:.1f}", f"{row.se:.1f}", probability(row.p), same),
        "parameters": [f"{name} {interval(value)}" for name, value in row.parameters.items()],
    }


def _leads(found: Findings) -> str:
    """Sentence on the lead of the accepted or most probable set over each fitted part of it."""
    sets = found.posterior
    first = found.accepted.model.names or sets.models[0].names
    leads = [
        f"{_effect_names(sorted(part.names))} by {sets.lead(first) - sets.lead(part.names):.0f}"
        for part in sets.models
        if part.names < first
    ]
    return f"{_effect_names(sorted(first))} leads {', '.join(leads)} nats." if leads else ""


def name_model(model: str) -> str:
    """Name of a model; for the one without effects, a description."""
    return "the refitted base" if model == "base" else model


def base(found: Findings, verdict: Verdict) -> dict[str, Any]:
    """Template values on the base: a table of stated and refitted values, and a note."""
    stated = {p.name: p for p in found.subject.scope.base}
    weak = "; ".join(found.fitted.weak)
    note = f"The runs say less than was known before of: {weak}."
    return {
        "rows": [_base_row(stated[name], value) for name, value in verdict.base.items()],
        "note": note if weak else "The runs determine all of it.",
    }


def _base_row(p: Parameter, value: Interval) -> tuple[str, ...]:
    start, refitted = _four_digits(p.start, p.unit), _four_digits(value.value, p.unit)
    return p.name, start, refitted, _interval_text(value.low, value.high, p.unit), unit(p.unit)


def _interval_text(low: float | None, high: float | None, of: str) -> str:
    if low is None or high is None:
        return ""
    return f"{_four_digits(low, of)} to {_four_digits(high, of)}"


def _four_digits(value: float, of: str) -> str:
    return number(in_small_unit(value, of), 4)
