"""What the best model leaves unexplained, in words."""

from collections.abc import Iterator

from cell.gap import shrink
from cell.gap.decide import drifting, unseen_remains
from cell.gap.findings import Findings
from cell.gap.verdict import Kind, Unexplained


def unexplained(found: Findings, which: Kind) -> Unexplained | None:
    """What remains: always for `unexplained`, and for `named` where more than noise is left."""
    judged = found.judged
    if which == "no_gap" or (which != "unexplained" and not judged.remains):
        return None
    law = judged.law
    return Unexplained(
        description=remainder(found),
        law=law.words if law else "no sparse law found",
        stable=bool(law and law.stable),
    )


def remainder(found: Findings) -> str:
    """One sentence on what the best model leaves, and why it is not believed."""
    quantities, shown = found.subject.scope.quantities, found.shown
    after = shrink.sizes(shown.after, quantities)
    least = shrink.floor(shown.before.evidence, quantities)
    sizes = ", ".join(
        f"{after[q.key]:.3g} {q.unit} of {q.key.rsplit('_', 1)[0]} (noise {least[q.key]:.2g})"
        for q in quantities.values()
        if q.key in after
    )
    best = found.judged.found.accepted.model.name
    of = "the refitted model" if best == "base" else f"the model with {best}"
    return "; ".join([f"{of} leaves {sizes} on held-out runs", *_reasons(found)])


def _reasons(found: Findings) -> Iterator[str]:
    """Why the best model is left open, or not all of the cause."""
    judged, drift = found.judged, drifting(found)
    if drift:
        yield f"the amplitude of {', '.join(drift)} drifts between conditions"
    if judged.drifts and judged.drift is not None:
        yield f"the specimen changes from run to run: {judged.drift.words}"
    if judged.astray is not None:
        yield f"run {judged.astray} goes another way"
    if judged.unsteady:
        factor = max(judged.inflation.values())
        yield f"repeats of one condition differ by {factor:.1f} times the stated noise"
    if judged.found.accepted.model.effects and unseen_remains(found):
        yield "the gap there is not even halved"
