"""Report section on held-out runs: the gap before and after, and what remains."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from cell.gap.diagnosis import held_out_gap
from cell.gap.fitting.gauss_newton import Estimate
from cell.gap.report import figures
from cell.gap.report.replayed import replay
from cell.gap.report.sentence import capital, change, label, motion, smallest, undetectable
from cell.gap.subject.subject import Run
from cell.gap.verdict.findings import Findings
from cell.gap.verdict.schema import Verdict
from drivers.types import Array


def compare_held_out(found: Findings, verdict: Verdict) -> dict[str, Any]:
    """Template values on the held-out runs, before and after: figures, a sentence, a table."""
    gap, before = verdict.gap, found.shown.before
    after = found.shown.after if found.shown.changed else None
    words = {q.key: f"{label(q)} [{q.unit}]" for q in found.subject.scope.quantities.values()}
    sides = [gap.before, gap.floor] if after is None else [gap.before, gap.after, gap.floor]
    names = conditions(before.evidence.runs)
    was = _excess_by_run(before)
    now = None if after is None else _excess_by_run(after)
    typical = int(np.argsort(was)[len(was) // 2])
    quantities = dict(found.subject.scope.quantities)
    return {
        "typical": names[typical],
        "midlines": _midline_figure(found, before.evidence.runs[typical].name),
        "traces": figures.residual_traces(before, after, typical, quantities),
        "shrank": f"{_shrinkage_words(found, verdict)}: {change(found, verdict)}",
        "head": ("rms", *(("gap",) if after is None else ("before", "after")), "noise"),
        "rows": [
            (words.get(key, "excess [noise]"), *(f"{side[key]:.3g}" for side in sides))
            for key in gap.before
        ],
        "leaves": bool(was.any() or (now is not None and now.any())),
        "bars": figures.run_bars(names, was, now) if len(names) > 1 else "",
    }


def _excess_by_run(fit: Estimate) -> Array:
    """Excess gap (R,) [noise] of each run."""
    return np.asarray(np.sqrt(np.maximum(held_out_gap.run_squares(fit) - 1.0, 0.0)))


def conditions(runs: Sequence[Run]) -> list[str]:
    """Names of the runs by their motion, such as `fast`; repeats are numbered."""
    short = [motion(run.condition) for run in runs]
    return [
        name if short.count(name) == 1 else f"{name} {short[: i + 1].count(name)}"
        for i, name in enumerate(short)
    ]


def _midline_figure(found: Findings, run: str) -> str:
    """Figure of the midlines of one held-out run, where the subject has curves."""
    drawn = next((r for r in replay(found, held_out_only=True) if r.name == run), None)
    return "" if drawn is None else figures.midlines(drawn)


def _shrinkage_words(found: Findings, verdict: Verdict) -> str:
    if not found.shown.changed:
        return "No effect was added"
    gap = verdict.gap
    if not gap.before["excess"]:
        return "Already before, the held-out runs together showed no more than noise"
    ends = f"[{100 * gap.shrink_low:.0f}, {100 * gap.shrink_high:.0f}]"
    return f"The gap shrank by {100 * gap.shrink:.0f} % {ends}"


def remains(found: Findings, verdict: Verdict) -> dict[str, Any]:
    """Template values on what the accepted model leaves, and on detection limits."""
    rest, law = verdict.unexplained, found.offered
    stable = "stable" if rest is not None and rest.stable else "not stable"
    what = "" if rest is None else capital(rest.description)
    return {
        "rest": what and f"{what}. A description, not a cause, {stable} over the runs",
        "law": "" if rest is None else rest.law,
        "share": f"{100 * law.shrink:.0f} %" if law else "none",
        "alike": "; ".join(" or ".join(group) for group in verdict.ambiguous),
        "silent": ", ".join(undetectable(found)),
        "detectable": [
            (name, smallest(found, name, value))
            for name, value in sorted(verdict.detectable.items())
        ],
    }
