"""Evidence of the report: where model and runs disagree, the candidates, the refitted base."""

from collections.abc import Sequence
from html import escape

from cell.gap.report import figures
from cell.gap.report.sentence import motion
from cell.gap.report.units import in_small_unit, interval, number, probability, unit
from cell.gap.selection.choice import MATERIAL
from cell.gap.verdict.compose import SEEN
from cell.gap.verdict.findings import Findings
from cell.gap.verdict.schema import Compared, Verdict

LISTED = 4  # sets of effects of which the page speaks
EXCLUDED = 1e-4  # probability below which a set counts as excluded: its size says nothing


def where(found: Findings) -> str:
    """A sentence and a map of the places where the refitted base exceeds noise, as HTML."""
    places = found.places
    strong = [place for place in places if place.p < SEEN]
    if not strong:
        return "<p>Nowhere beyond what noise does.</p>" + figures.heat_map(places)
    first = strong[0]
    text = (
        f"Strongest in {first.channel}, {first.zone} zone, {first.phase} phase of "
        f"{motion(first.condition)}: {abs(first.z):.0f} sigma. {len(strong)} of {len(places)} "
        "places disagree beyond noise (dots; family-wise 5 %). Shown is the model after its base "
        "parameters were refitted."
    )
    alone = sum(place.p < SEEN for place in found.fitted.places)
    if found.judged.places and alone < len(strong):
        text += (
            f" By itself {alone or 'none'} of them would stand out from noise and from what "
            f"differs from run to run; the others are where what is left goes the way of "
            f"{found.accepted.model.name}."
        )
    return f"<p>{escape(text)}</p>" + figures.heat_map(places)


def candidates(found: Findings, verdict: Verdict) -> str:
    """Every model that was tried, by what it gains on runs left out, as HTML."""
    accepted = found.accepted.model.name
    rows = "".join(_row(row, row.name == accepted) for row in verdict.candidates)
    note = (
        "What each effect gains in predicting runs that the fit had not seen, in nats (4 nats: "
        "55 times as likely). A further effect is taken for "
        f"{found.by.least:.0f} nats, p below 0.01 over all candidates, and at least "
        f"{100 * MATERIAL:.0f} % of the excess gap that was left."
    )
    model_error = max((e.model_error for e in found.accepted.model.effects), default=0.0)
    if model_error:
        note += (
            f" Beside those taken, up to {100 * model_error:.0f} % of what they gained in a run "
            "is put down to their laws there, which may be wrong by as much."
        )
    head = (
        "<tr><th>effect<th class='n'>gain [nats]<th class='n'>scatter over runs"
        "<th class='n'>p<th class='n'>same amplitude, p<th>parameters (95 %)</tr>"
    )
    bars = figures.candidate_bars(verdict.candidates, accepted) if verdict.candidates else ""
    same = "<p class='note'>Same amplitude: whether one size serves all conditions.</p>"
    numbers = f"<div class='wide'><table>{head}{rows}</table></div>"
    table = f"<details><summary>All numbers</summary>{same}{numbers}</details>"
    silent = [p.candidate.name for p in found.screened.probed if p.dead]
    dead = f"<p class='note'>Changes nothing in these runs: {', '.join(silent)}.</p>"
    parts = (f"<p class='note'>{note}</p>", bars, _steps(found), _probable(verdict))
    return f"{''.join(parts)}{dead if silent else ''}{table}"


def _probable(verdict: Verdict) -> str:
    """The most probable sets of effects, in a sentence."""
    if verdict.posterior is None or len(verdict.posterior.models) < 2:
        return ""
    first, *others = verdict.posterior.models[:LISTED]
    others = [m for m in others if m.p > EXCLUDED]
    rest = [f"{_set(m.names)} {probability(m.p)}" for m in others]
    also = f"; besides {', '.join(rest)}" if rest else "; all others are excluded"
    text = (
        f"Of the sets of effects that were fitted, by their evidence: {_set(first.names)} "
        f"{number(first.p, 2)}{also}. On held-out runs {number(verdict.posterior.left, 2)} times "
        "noise and floor are left. A cause outside the library is not among them."
    )
    return f"<p class='note'>{escape(text)}</p>"


def _set(names: Sequence[str]) -> str:
    return " + ".join(names) or "the base alone"


def _row(row: Compared, best: bool) -> str:
    parameters = "<br>".join(
        f"{escape(name)} {escape(interval(value))}" for name, value in row.parameters.items()
    )
    same = "" if row.invariance_p is None else probability(row.invariance_p)
    return (
        f"<tr{' class=best' if best else ''}><td>{escape(row.name)}"
        f"<td class='n'>{row.elpd_gain:.1f}<td class='n'>{row.se:.1f}"
        f"<td class='n'>{probability(row.p)}<td class='n'>{same}<td class='p'>{parameters}</tr>"
    )


def _steps(found: Findings) -> str:
    """How the number of effects was decided, level by level."""
    lines = []
    for count, step in enumerate(found.choice.steps, start=1):
        verb = "taken" if step.accepted else "not taken"
        over = name_model(step.before.model.name)
        lines.append(
            f"<li>{count} effect{'s' if count > 1 else ''}: {escape(step.model.model.name)} gains "
            f"{step.gain:.1f} nats over {escape(over)} (p {probability(step.p)}) and removes "
            f"{100 * step.removed:.0f} % of its excess gap: {verb}.</li>"
        )
    return f"<ul class='note'>{''.join(lines)}</ul>" if lines else ""


def name_model(model: str) -> str:
    """A model by name; the one without effects in words."""
    return "the refitted base" if model == "base" else model


def base(found: Findings, verdict: Verdict) -> str:
    """Stated and refitted values of the base, as HTML."""
    stated = {p.name: p for p in found.subject.scope.base}
    rows = "".join(
        f"<tr><td>{escape(name)}<td class='n'>{_four(stated[name].start, of)}<td class='n'>"
        f"{_four(value.value, of)}<td class='n'>{_ends(value.low, value.high, of)}"
        f"<td>{escape(unit(of))}</tr>"
        for name, value in verdict.base.items()
        for of in [stated[name].unit]
    )
    weak = escape("; ".join(u.words for u in found.fitted.weak))
    note = "The runs determine all of it."
    if weak:
        note = f"The runs say less than was known before of: {weak}."
    return (
        "<div class='wide'><table><tr><th>parameter<th class='n'>stated<th class='n'>refitted"
        "<th class='n'>95 %"
        f"<th>unit</tr>{rows}</table></div><p class='note'>{note}</p>"
    )


def _ends(low: float | None, high: float | None, of: str) -> str:
    if low is None or high is None:
        return ""
    return f"{_four(low, of)} to {_four(high, of)}"


def _four(value: float, of: str) -> str:
    return number(in_small_unit(value, of), 4)
