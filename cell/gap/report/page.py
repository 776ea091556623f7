"""`report.html`: one page for a technician, whole in itself."""

from collections.abc import Sequence
from html import escape
from pathlib import Path

import numpy as np

from cell.gap.diagnosis import held_out_gap
from cell.gap.report import figures
from cell.gap.report.replayed import replayed
from cell.gap.report.sentence import capital, change, label, sentence, smallest, undetectable
from cell.gap.report.units import interval, number, probability, unit
from cell.gap.selection.choice import MATERIAL
from cell.gap.verdict.findings import Findings
from cell.gap.verdict.schema import Compared, Verdict, write_text
from drivers.types import Array

TITLES = {
    "named": "Named",
    "ambiguous": "Cannot tell which",
    "no_gap": "No gap",
    "unexplained": "Unexplained",
}
STYLE = """
:root{color-scheme:light}
body{font:15px/1.5 system-ui,sans-serif;color:#22272e;background:#fff;max-width:60rem;
margin:2rem auto;padding:0 1.2rem}
h1{font-size:1.05rem;font-weight:600;margin:0;color:#5b6470}
h2{font-size:1.05rem;margin:2.2rem 0 .4rem}
.verdict{border-left:6px solid #2f6db3;padding:.6rem 1rem;background:#f3f6fa;margin:.8rem 0}
.verdict.unexplained,.verdict.ambiguous{border-color:#c98a1b;background:#fdf7ea}
.verdict.no_gap{border-color:#4c8f5b;background:#f0f7f1}
.verdict b{display:block;font-size:.85rem;letter-spacing:.04em;text-transform:uppercase}
.verdict p{font-size:1.15rem;margin:.2rem 0}
table{border-collapse:collapse;font-size:.86rem;margin:.4rem 0}
th,td{text-align:left;padding:.25rem .7rem .25rem 0;border-bottom:1px solid #e3e7ec;
vertical-align:top}
td.n,th.n{text-align:right;font-variant-numeric:tabular-nums;white-space:nowrap}
td.p{font-size:.92em}summary{cursor:pointer;font-size:.88rem}
tr.best{background:#eaf2fb}
svg{max-width:100%;height:auto}
.note{color:#5b6470;font-size:.88rem}
""".replace("\n", " ")


def write_report(found: Findings, verdict: Verdict, path: Path) -> None:
    """The page at `path`."""
    write_text(path, page(found, verdict))


def page(found: Findings, verdict: Verdict) -> str:
    """The page as text."""
    sections = [
        _head(found, verdict),
        _section("Where they disagree", _where(found)),
        _section("Candidates", _candidates(found, verdict)),
        _section("Before and after, on runs that were held out", _shown(found, verdict)),
        _section("What remains", _remains(found, verdict)),
        _section("What to do next", _next(verdict)),
        _section("The refitted base", _base(found, verdict)),
        _foot(verdict),
    ]
    return (
        "<!doctype html><html lang='en'><head><meta charset='utf-8'>"
        f"<title>{escape(found.subject.name)}: simulation and measurement</title>"
        f"<meta name='viewport' content='width=device-width'><style>{STYLE}</style></head><body>"
        + "".join(sections)
        + "</body></html>\n"
    )


def _section(title: str, content: str) -> str:
    return f"<h2>{escape(title)}</h2>{content}"


def _head(found: Findings, verdict: Verdict) -> str:
    runs, held = len(found.subject.runs), len(verdict.held_out)
    return (
        f"<h1>{escape(found.subject.name)}: simulation against {runs} measured runs, "
        f"{held} of them held out</h1>"
        f"<div class='verdict {verdict.verdict}'><b>{TITLES[verdict.verdict]}</b>"
        f"<p>{escape(sentence(found, verdict))}</p></div>"
        + "".join(f"<p class='note'>{escape(note)}</p>" for note in found.subject.notes)
    )


def _where(found: Findings) -> str:
    places = found.fitted.places
    strong = [place for place in places if place.p < 0.05]
    if not strong:
        return "<p>Nowhere beyond what noise does.</p>" + figures.heat_map(places)
    first = strong[0]
    text = (
        f"Strongest in {first.channel}, {first.zone} zone, {first.phase} phase of condition "
        f"{first.condition}: {abs(first.z):.0f} sigma. {len(strong)} of {len(places)} places "
        "disagree beyond noise (dots; family-wise 5 %). Shown is the model after its base "
        "parameters were refitted."
    )
    return f"<p>{escape(text)}</p>" + figures.heat_map(places)


def _candidates(found: Findings, verdict: Verdict) -> str:
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
    table = f"<details><summary>All numbers</summary>{same}<table>{head}{rows}</table></details>"
    silent = [p.candidate.name for p in found.screened.probed if p.dead]
    dead = f"<p class='note'>Changes nothing in these runs: {', '.join(silent)}.</p>"
    return f"<p class='note'>{note}</p>{bars}{_steps(found)}{dead if silent else ''}{table}"


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
        over = _told(step.before.model.name)
        lines.append(
            f"<li>{count} effect{'s' if count > 1 else ''}: {escape(step.model.model.name)} gains "
            f"{step.gain:.1f} nats over {escape(over)} (p {probability(step.p)}) and removes "
            f"{100 * step.removed:.0f} % of its excess gap: {verb}.</li>"
        )
    return f"<ul class='note'>{''.join(lines)}</ul>" if lines else ""


def _told(model: str) -> str:
    return "the refitted base" if model == "base" else model


def _shown(found: Findings, verdict: Verdict) -> str:
    gap, before, after = verdict.gap, found.shown.before, found.shown.after
    words = {q.key: f"{label(q)} [{q.unit}]" for q in found.subject.scope.quantities.values()}
    changed = after is not before
    rows = "".join(
        f"<tr><td>{escape(words.get(key, 'excess [noise]'))}<td class='n'>{gap.before[key]:.3g}"
        + (f"<td class='n'>{gap.after[key]:.3g}" if changed else "")
        + f"<td class='n'>{gap.floor[key]:.3g}</tr>"
        for key in gap.before
    )
    columns = "<th class='n'>before<th class='n'>after" if changed else "<th class='n'>gap"
    names = [run.name for run in before.evidence.runs]
    was = np.sqrt(np.maximum(held_out_gap.run_squares(before) - 1.0, 0.0))
    now = np.sqrt(np.maximum(held_out_gap.run_squares(after) - 1.0, 0.0)) if changed else was
    typical = int(np.argsort(was)[len(was) // 2])
    quantities = dict(found.subject.scope.quantities)
    return (
        f"<p>{_shrank(found, verdict)}: {escape(change(found, verdict))}.</p>"
        f"<table><tr><th>rms{columns}<th class='n'>noise</tr>{rows}</table>"
        + _excess(names, was, now)
        + f"<p class='note'>Measured minus simulated in held-out run {escape(names[typical])}; "
        "the grey band is two sigma of one reading.</p>"
        + figures.residual_traces(before, after, typical, quantities)
        + _drawn(found, names[typical])
    )


def _excess(names: Sequence[str], was: Array, now: Array) -> str:
    """What each held-out run leaves beyond noise."""
    if not (was.any() or now.any()):
        return "<p class='note'>No held-out run leaves more than noise.</p>"
    note = "<p class='note'>What each held-out run leaves beyond noise; no bar: nothing.</p>"
    return note + figures.run_bars(names, was, now)


def _drawn(found: Findings, name: str) -> str:
    """The curve of one held-out run, where the subject has curves."""
    drawn = next((r for r in replayed(found, held_out_only=True) if r.name == name), None)
    figure = "" if drawn is None else figures.midlines(drawn)
    note = "The same run at four moments; overlay.rrd shows all runs in motion."
    return f"<p class='note'>{note}</p>{figure}" if figure else ""


def _shrank(found: Findings, verdict: Verdict) -> str:
    if found.shown.after is found.shown.before:
        return "No effect was added"
    gap = verdict.gap
    if not gap.before["excess"]:
        return "Already before, the held-out runs together showed no more than noise"
    ends = f"[{100 * gap.shrink_low:.0f}, {100 * gap.shrink_high:.0f}]"
    return f"The gap shrank by {100 * gap.shrink:.0f} % {ends}"


def _remains(found: Findings, verdict: Verdict) -> str:
    parts = []
    if verdict.unexplained is not None:
        rest = verdict.unexplained
        stable = "stable over the runs" if rest.stable else "not stable over the runs"
        share = f"{100 * found.judged.law.share:.0f} %" if found.judged.law else "none"
        parts.append(
            f"<p>{escape(capital(rest.description))}. A description, not a cause, {stable}: "
            f"<code>{escape(rest.law)}</code> (accounts for {share} of what remains).</p>"
        )
    if verdict.ambiguous:
        groups = "; ".join(" or ".join(group) for group in verdict.ambiguous)
        parts.append(f"<p>Not told apart by these runs: {escape(groups)}.</p>")
    if not parts:
        parts.append("<p>Nothing beyond the noise.</p>")
    return "".join(parts) + _detectable(found, verdict)


def _detectable(found: Findings, verdict: Verdict) -> str:
    rows = "".join(
        f"<tr><td>{escape(name)}<td class='n'>{escape(smallest(found, name, value))}</tr>"
        for name, value in sorted(verdict.detectable.items())
    )
    silent = undetectable(found)
    never = f"Not detectable here at any possible size: {', '.join(silent)}." if silent else ""
    return (
        "<p class='note'>The smallest size of each effect that these runs would have shown "
        f"(8 sigma or more after the base is refitted). {escape(never)}</p><table>{rows}</table>"
    )


def _next(verdict: Verdict) -> str:
    if not verdict.advice:
        return "<p>No planned experiment would tell more than these runs do.</p>"
    rows = "".join(
        f"<tr><td>{escape(a.experiment)}<td>{escape(_told(a.separates[0]))} from "
        f"{escape(_told(a.separates[1]))}<td class='n'>{a.expected_sigma:.1f}"
        f"<td class='n'>{a.minutes:.1f}</tr>"
        for a in verdict.advice[:5]
    )
    return (
        "<table><tr><th>experiment<th>tells<th class='n'>sigma<th class='n'>minutes</tr>"
        f"{rows}</table>"
    )


def _base(found: Findings, verdict: Verdict) -> str:
    stated = {p.name: p for p in found.subject.scope.base}
    rows = "".join(
        f"<tr><td>{escape(name)}<td class='n'>{number(stated[name].start, 4)}<td class='n'>"
        f"{number(value.value, 4)}<td class='n'>{_ends(value.low, value.high)}"
        f"<td>{escape(unit(stated[name].unit))}</tr>"
        for name, value in verdict.base.items()
    )
    weak = found.fitted.weak
    note = _weak([u.words for u in weak]) if weak else "The runs determine all of it."
    return (
        "<table><tr><th>parameter<th class='n'>stated<th class='n'>refitted<th class='n'>95 %"
        f"<th>unit</tr>{rows}</table><p class='note'>{note}</p>"
    )


def _weak(words: Sequence[str]) -> str:
    return "The runs say less than was known before of: " + escape("; ".join(words)) + "."


def _ends(low: float | None, high: float | None) -> str:
    return f"{number(low, 4)} to {number(high, 4)}" if low is not None and high is not None else ""


def _foot(verdict: Verdict) -> str:
    return (
        f"<p class='note'>{verdict.simulations} simulated runs in {verdict.runtime:.0f} s. "
        f"Held out: {escape(', '.join(verdict.held_out))}.</p>"
    )
