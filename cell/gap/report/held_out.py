"""What the report shows of held-out runs: the gap before and after, and what remains."""

from collections.abc import Sequence
from html import escape

import numpy as np

from cell.gap.diagnosis import held_out_gap
from cell.gap.report import figures
from cell.gap.report.replayed import replay
from cell.gap.report.sentence import capital, change, label, motion, smallest, undetectable
from cell.gap.subject.subject import Run
from cell.gap.verdict.findings import Findings
from cell.gap.verdict.schema import Verdict
from drivers.types import Array


def compare_held_out(found: Findings, verdict: Verdict) -> str:
    """Measured, before and after on held-out runs: pictures, then the table, as HTML."""
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
    names = conditions(before.evidence.runs)
    was = np.sqrt(np.maximum(held_out_gap.run_squares(before) - 1.0, 0.0))
    now = np.sqrt(np.maximum(held_out_gap.run_squares(after) - 1.0, 0.0)) if changed else was
    typical = int(np.argsort(was)[len(was) // 2])
    quantities = dict(found.subject.scope.quantities)
    run = before.evidence.runs[typical].name
    return (
        _figure(found, run, names[typical])
        + f"<p class='note'>Measured minus simulated, magnified, in {escape(names[typical])}; "
        "the grey band is two sigma of one reading.</p>"
        + figures.residual_traces(before, after, typical, quantities)
        + f"<p>{_shrank(found, verdict)}: {escape(change(found, verdict))}.</p>"
        f"<div class='wide'><table><tr><th>rms{columns}<th class='n'>noise</tr>{rows}</table></div>"
        + _excess(names, was, now)
    )


def conditions(runs: Sequence[Run]) -> list[str]:
    """Runs by what was done in them, such as `fast`; repeats are numbered."""
    short = [motion(run.condition) for run in runs]
    return [
        name if short.count(name) == 1 else f"{name} {short[: i + 1].count(name)}"
        for i, name in enumerate(short)
    ]


def _excess(names: Sequence[str], was: Array, now: Array) -> str:
    """What each held-out run leaves beyond noise."""
    if not (was.any() or now.any()):
        return "<p class='note'>No held-out run leaves more than noise.</p>"
    if len(names) == 1:
        return ""
    note = "<p class='note'>What each held-out run leaves beyond noise; no bar: nothing.</p>"
    return note + figures.run_bars(names, was, now)


def _figure(found: Findings, run: str, words: str) -> str:
    """The curve of one held-out run, where the subject has curves."""
    drawn = next((r for r in replay(found, held_out_only=True) if r.name == run), None)
    figure = "" if drawn is None else figures.midlines(drawn)
    note = f"{words} at four moments; overlay.rrd shows all runs in motion."
    return f"<p class='note'>{escape(note)}</p>{figure}" if figure else ""


def _shrank(found: Findings, verdict: Verdict) -> str:
    if found.shown.after is found.shown.before:
        return "No effect was added"
    gap = verdict.gap
    if not gap.before["excess"]:
        return "Already before, the held-out runs together showed no more than noise"
    ends = f"[{100 * gap.shrink_low:.0f}, {100 * gap.shrink_high:.0f}]"
    return f"The gap shrank by {100 * gap.shrink:.0f} % {ends}"


def remains(found: Findings, verdict: Verdict) -> str:
    """What the accepted model leaves, and what these runs would have shown, as HTML."""
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
        parts.append(f"<p>Alike in these runs: {escape(groups)}.</p>")
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
        f"(8 sigma or more after the base is refitted). {escape(never)}</p>"
        f"<div class='wide'><table>{rows}</table></div>"
    )
