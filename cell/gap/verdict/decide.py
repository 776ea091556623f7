"""Choose one of the four verdicts from the findings."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from cell.gap.diagnosis import held_out_gap
from cell.gap.fitting import robust
from cell.gap.fitting.gauss_newton import Estimate
from cell.gap.selection.likelihood import ALPHA, MIN_GAIN, clip_wild, margin
from cell.gap.subject.subject import Run
from cell.gap.verdict.confidence import LEFT_OPEN, calibration
from cell.gap.verdict.findings import Findings
from cell.gap.verdict.schema import Kind, Unexplained


@dataclass(frozen=True, slots=True)
class Bars:
    """Thresholds of a verdict, as excess gaps (of the noise) or shares.

    An excess gap on held-out runs below `noise` is none, one above `seen` is a gap by itself. A
    model rests on one run that gives the share `one` of its gain; others confirm it where it closes
    the share `half` of a gap. Source: set by hand in sight of exams.
    """

    noise: float = 0.3
    seen: float = 0.5
    half: float = 0.5
    one: float = 0.9


BARS = Bars()


def kind(found: Findings) -> Kind:
    """Kind of verdict that the findings support."""
    if not found.accepted.model.effects:
        return "unexplained" if gap_is_there(found) else "no_gap"
    if any(objection.refutes for objection in objections(found)):
        return "unexplained"
    return "named" if found.sure else "ambiguous"


@dataclass(frozen=True, slots=True)
class Objection:
    """An objection to the accepted model, in `words`; one that `refutes` leaves the gap open."""

    words: str
    refutes: bool = True


def objections(found: Findings) -> Iterator[Objection]:
    """Objections to the accepted model, or to the base where nothing was accepted.

    No effect of one size describes all runs where amplitudes or repeats differ, the specimen
    drifts, or the fit misses more than is tolerated. A true cause leaves little on held-out runs,
    and no description without a cause is clearly more probable than it.
    """
    judged = found.judged
    if drift := drifting(found):
        where = "conditions or phases" if judged.phases else "conditions"
        yield Objection(f"the amplitude of {', '.join(drift)} drifts between {where}")
    if judged.repeats.drifts and judged.repeats.drift is not None:
        words = judged.repeats.drift.words
        yield Objection(f"the specimen changes from run to run: {words}")
    if judged.outlying_run is not None:
        words = f"run {judged.outlying_run} goes another way"
        yield Objection(words, refutes=not _others_confirm(found))
    if judged.repeats.differ:
        factor = max(judged.repeats.inflation.values())
        yield Objection(f"repeats of one condition differ by {factor:.1f} times the stated noise")
    if judged.leftover < ALPHA:
        yield Objection("")  # the sizes that are left are told beside
    if found.accepted.model.effects and leaves_too_much(found):
        left, most = held_out_gap.rms_left(found.shown.after), most_left(found)
        closed = 100.0 * found.shown.shrink.value
        yield Objection(
            f"that is {left:.2g} times noise and floor, where a true cause leaves at most "
            f"{most:.2g}, and {closed:.0f} % of the gap is closed"
        )
    if found.offered is not None and found.offered.refutes:
        yield Objection("a law without a cause is clearly more probable")


def leaves_too_much(found: Findings) -> bool:
    """Whether the accepted model leaves more on held-out runs than one with the true cause does.

    As much may stay, too, as a law gets wrong of a large gap.
    """
    above = held_out_gap.rms_left(found.shown.after) > most_left(found)
    return above and found.shown.shrink.value < 1.0 - found.subject.scope.left


def most_left(found: Findings) -> float:
    """Rms on held-out runs, in units of noise and floor, above which a verdict stays open.

    As calibrated, or what noise alone may leave, where there is little floor beside it.
    """
    return max(
        calibration().most_left, held_out_gap.noise_rms(found.shown.after.evidence, LEFT_OPEN)
    )


def gap_is_there(found: Findings) -> bool:
    """Whether the base leaves a gap that shows in a place or on held-out runs.

    A misfit as a whole that no place shows, and no run that was held out, is no gap.
    """
    if not found.fitted.gap:
        return False
    return any(place.p < ALPHA for place in found.fitted.places) or unseen_gap(found) > BARS.seen


def in_doubt(found: Findings) -> bool:
    """Whether the named effects may imitate another cause.

    So may several, those that leave more than noise on any runs, or that rest on a single run.
    """
    if len(found.accepted.model.effects) > 1 or found.judged.remains:
        return True
    return _bounded_gap(found.shown.after) > BARS.noise or lone_run(found) is not None


def unseen_gap(found: Findings) -> float:
    """Excess gap of the base on held-out runs, wild samples bounded."""
    return _bounded_gap(found.shown.before)


def _bounded_gap(estimate: Estimate) -> float:
    """Excess gap of `estimate`, with wild samples bounded at its own dispersion."""
    scale = robust.scale(np.concatenate(estimate.residuals))
    clipped = tuple(clip_wild(estimate.residuals, scale))
    return held_out_gap.excess_of(replace(estimate, residuals=clipped))


def _others_confirm(found: Findings) -> bool:
    """Whether the accepted model gains in all runs but the outlying one."""
    outlying, base = found.judged.outlying_run, found.choice.fits.base
    each = margin(found.accepted, base, found.by).each
    others = [run.name != outlying for run in base.estimate.evidence.runs]
    return float(each[others].sum()) > MIN_GAIN


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
    is_confirmed = unseen_gap(found) > BARS.noise and found.shown.shrink.value > BARS.half
    if is_confirmed or others > MIN_GAIN or each[best] < BARS.one * each.sum():
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
    reasons = [objection.words for objection in objections(found) if objection.words]
    return "; ".join([f"{of} leaves {sizes} on held-out runs", *reasons])
