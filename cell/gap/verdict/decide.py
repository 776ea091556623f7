"""Choose one of the four verdicts from the findings."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from cell.gap.diagnosis import held_out_gap
from cell.gap.fitting import robust
from cell.gap.fitting.gauss_newton import Estimate
from cell.gap.selection.likelihood import ALPHA, clip_wild, margin, remaining_gap, share_removed
from cell.gap.subject.subject import Run
from cell.gap.verdict.findings import Findings
from cell.gap.verdict.schema import Kind, Unexplained


@dataclass(frozen=True, slots=True)
class Bars:
    """Thresholds of a verdict, as shares of the excess gap or in its units (of the noise).

    A named model has removed the share `most`, where more than noise is left, and `half` of a gap
    on held-out runs that is `clear`, or leaves no more than the `law` of a true cause gets wrong; a
    gap below `noise` is none. A model rests on one run that gives the share `one` of its gain.
    Source: set by hand in sight of exams.
    """

    most: float = 0.6
    clear: float = 1.0
    half: float = 0.5
    law: float = 1.0
    noise: float = 0.3
    one: float = 0.9


BARS = Bars()


def kind(found: Findings) -> Kind:
    """Kind of verdict that the findings support."""
    judged = found.judged
    if not found.accepted.model.effects:
        return "unexplained" if gap_is_there(found) else "no_gap"
    changes = judged.repeats.drifts or judged.repeats.differ or drifting(found)
    if judged.leftover < ALPHA or changes or not _explains_most(found) or unseen_remains(found):
        return "unexplained"
    if is_proxy(found):
        return "unexplained"
    return "named" if found.sure else "ambiguous"


def gap_is_there(found: Findings) -> bool:
    """Whether the base leaves a gap that shows in a place or on held-out runs.

    A misfit as a whole that no place shows, and no run that was held out, is no gap.
    """
    if not found.fitted.gap:
        return False
    return any(place.p < ALPHA for place in found.fitted.places) or unseen_gap(found) > BARS.half


def is_proxy(found: Findings) -> bool:
    """Whether several accepted effects only imitate a cause: they leave a clear part of the gap.

    One effect of a nearly true law may leave some of what it explains; of two, each would have to
    take up what the other gets wrong, as they do for a cause that the library does not hold.
    """
    if len(found.accepted.model.effects) < 2:
        return False
    was, now = _gaps(found)
    return now > BARS.noise and now > found.subject.scope.left * was


def in_doubt(found: Findings) -> bool:
    """Whether the named effects may imitate another cause.

    So may several, those that leave more than noise on any runs, or that rest on a single run.
    """
    if len(found.accepted.model.effects) > 1 or found.judged.remains:
        return True
    return _gaps(found)[1] > BARS.noise or lone_run(found) is not None


def unseen_gap(found: Findings) -> float:
    """Excess gap of the base on held-out runs, wild samples bounded."""
    return _bounded_gap(found.shown.before, found.shown.before)


def _explains_most(found: Findings) -> bool:
    """Whether the accepted model leaves only noise, or removes most of the excess gap.

    As little as a law may get wrong may be left, too. Where a run is an outlier, the others alone
    must confirm the model.
    """
    judged, by = found.judged, found.by
    if not judged.remains:
        return True
    base = found.choice.fits.base
    each = margin(found.accepted, base, by).each
    others = [run.name != judged.outlying_run for run in base.estimate.evidence.runs]
    gain = float(each[others].sum())
    best, without = found.accepted, judged.outlying_run
    gap = remaining_gap(best, by, without)
    little = gap <= BARS.law or share_removed(best, base, by, without) > BARS.most
    return gain > by.least and little


def unseen_remains(found: Findings) -> bool:
    """Whether held-out runs show a clear gap that the accepted model does not close.

    That is, it neither halves it nor leaves as little as a law may get wrong.
    """
    before, after = _gaps(found)
    return before > BARS.clear and after > max(BARS.half * before, BARS.law)


def _gaps(found: Findings) -> tuple[float, float]:
    """Excess gaps of base and accepted model on held-out runs, bounded at the latter's scale."""
    after = found.shown.after
    return _bounded_gap(found.shown.before, after), _bounded_gap(after, after)


def _bounded_gap(estimate: Estimate, beside: Estimate) -> float:
    """Excess gap of `estimate`, with wild samples bounded at the dispersion of `beside`."""
    scale = robust.scale(np.concatenate(beside.residuals))
    clipped = tuple(clip_wild(estimate.residuals, scale))
    return held_out_gap.excess_of(replace(estimate, residuals=clipped))


def drifting(found: Findings) -> list[str]:
    """Accepted effects that are proxies: their amplitude differs between conditions or phases."""
    tests = found.judged.invariances.get(found.accepted.model.name, {})
    names = [name for name, test in tests.items() if not test.holds]
    return [
        *names,
        *(t.effect for t in found.judged.phases if not t.holds and t.effect not in names),
    ]


def lone_run(found: Findings) -> Run | None:
    """The single run that the accepted model rests on; None where others confirm the model.

    The other fitted runs confirm it if they gain enough, held-out ones if they show a gap that the
    model closes.
    """
    by, base, accepted = found.by, found.choice.fits.base, found.accepted
    if not accepted.model.effects:
        return None
    each = margin(accepted, base, by).each
    best = int(np.argmax(each))
    others = float(each.sum() - each[best])
    is_confirmed = unseen_gap(found) > BARS.noise and not unseen_remains(found)
    if is_confirmed or others > by.least or each[best] < BARS.one * each.sum():
        return None
    return base.estimate.evidence.runs[best]


def describe_rest(found: Findings, which: Kind) -> Unexplained | None:
    """Description of an unexplained gap, or of what an accepted model leaves; None if nothing."""
    if which == "no_gap" or not (which == "unexplained" or found.judged.remains):
        return None
    law = found.offered.words if found.offered is not None else "no sparse law found"
    return Unexplained(
        description=unexplained_part(found), law=law, stable=found.offered is not None
    )


def unexplained_part(found: Findings) -> str:
    """Sentence on what the best model leaves, and why it is not believed."""
    quantities, shown = found.subject.scope.quantities, found.shown
    after = held_out_gap.sizes(shown.after, quantities)
    least = held_out_gap.floor(shown.before.evidence, quantities)
    sizes = ", ".join(
        f"{after[q.key]:.3g} {q.unit} of {q.key.rsplit('_', 1)[0]} (noise {least[q.key]:.2g})"
        for q in quantities.values()
        if q.key in after
    )
    best = found.accepted.model.name
    of = "the refitted model" if best == "base" else f"the model with {best}"
    return "; ".join([f"{of} leaves {sizes} on held-out runs", *_reasons(found)])


def _reasons(found: Findings) -> Iterator[str]:
    """Reasons why the best model is not, or not wholly, the cause."""
    judged, drift = found.judged, drifting(found)
    if drift:
        where = "conditions or phases" if judged.phases else "conditions"
        yield f"the amplitude of {', '.join(drift)} drifts between {where}"
    if judged.repeats.drifts and judged.repeats.drift is not None:
        yield f"the specimen changes from run to run: {judged.repeats.drift.words}"
    if judged.outlying_run is not None:
        yield f"run {judged.outlying_run} goes another way"
    if judged.repeats.differ:
        factor = max(judged.repeats.inflation.values())
        yield f"repeats of one condition differ by {factor:.1f} times the stated noise"
    if found.accepted.model.effects and unseen_remains(found):
        yield "the gap there is not even halved"
    if is_proxy(found):
        closed = 100 * found.shown.shrink.value
        yield f"together they describe {closed:.0f} % of the gap, as no cause of theirs would"
