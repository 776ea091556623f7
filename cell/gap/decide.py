"""What findings bear: a name, a class, no gap, or that the cause is left open."""

from dataclasses import replace

import numpy as np

from cell.gap import robust, shrink
from cell.gap.compare import LEVEL, MARGIN, bounded, margin, removed
from cell.gap.findings import Findings
from cell.gap.refit import Estimate
from cell.gap.verdict import Kind

MOST = 0.6  # of the excess gap: a named model has removed more, where more than noise is left
CLEAR, HALF = 1.0, 0.5  # excess gap on held-out runs of which a named model takes its share
SURE = 0.97  # no confidence is stated above this: a cause may lie outside the library
LARGE = 700.0  # nats whose exponential is still a number


def kind(found: Findings) -> Kind:
    """Which of the four verdicts the findings bear."""
    judged = found.judged
    if not judged.found.accepted.model.effects:
        return "unexplained" if found.fitted.gap else "no_gap"
    changes = judged.drifts or judged.unsteady or drifting(found)
    if judged.leftover.p < LEVEL or changes or not _mostly(found) or unseen_remains(found):
        return "unexplained"
    return "named" if judged.sure else "ambiguous"


def _mostly(found: Findings) -> bool:
    """Whether the whole model leaves only noise, or has removed most of the excess gap; where a
    run went another way, the others alone must bear the model out.
    """
    judged, by = found.judged, found.judged.found.by
    if not judged.remains:
        return True
    base = next(m for m in judged.found.tried if not m.model.effects)
    each = margin(judged.found.accepted, base, by).each
    others = [run.name != judged.astray for run in base.estimate.evidence.runs]
    gain = float(each[others].sum())
    return gain > by.least and removed(judged.found.accepted, base, by, judged.astray) > MOST


def unseen_remains(found: Findings) -> bool:
    """Whether runs that took no part show a clear gap, and the model does not even halve it; no
    sample counts beyond what is wild among those that the model leaves.
    """
    shown = found.shown
    scale = robust.scale(np.concatenate(shown.after.residuals))
    before, after = (_bounded_gap(estimate, scale) for estimate in (shown.before, shown.after))
    return before > CLEAR and after > HALF * before


def _bounded_gap(estimate: Estimate, scale: float) -> float:
    residuals = tuple(bounded(estimate.residuals, scale))
    return float(shrink.excess(shrink.run_squares(replace(estimate, residuals=residuals))))


def drifting(found: Findings) -> list[str]:
    """Effects whose amplitude does not serve all conditions: proxies, not causes."""
    tests = found.judged.invariances.get(found.judged.found.accepted.model.name, {})
    return [name for name, test in tests.items() if not test.holds]


def confidence(found: Findings) -> float:
    """Weight of the model of all that was earned, and of its rivals, among the models of its size
    and the base; of what it is ahead of the others a part may be feigned.
    """
    judged, by = found.judged, found.judged.found.by
    whole = judged.found.accepted
    size = len(whole.model.effects)
    own = {whole.model.names, *(r.model.model.names for r in judged.rivals)}
    among = [m for m in judged.found.tried if len(m.model.effects) in (0, size)]
    others = [m for m in among if m.model.names not in own]
    base = next(m for m in judged.found.tried if not m.model.effects)
    feigned = by.ahead(margin(whole, base, by).gain) - MARGIN
    ahead = [margin(whole, m, by).gain - feigned for m in others]
    return min(SURE, 1.0 / (1.0 + sum(float(np.exp(-min(a, LARGE))) for a in ahead)))
