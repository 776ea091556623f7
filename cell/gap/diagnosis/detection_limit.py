"""Smallest size of each effect that these runs would have shown."""

from collections.abc import Sequence

import numpy as np

from cell.gap.fitting.projection import Projection
from cell.gap.selection.likelihood import MIN_GAIN, LikelihoodScale
from cell.gap.selection.screening import Probed
from cell.gap.subject.subject import Parameter

# after the base is refitted, at which cross-validation too is sure of it; set by hand
DETECTED_SIGMA = 8.0


def detectable(
    about: Projection, probed: Sequence[Probed], by: LikelihoodScale
) -> dict[str, float | None]:
    """Smallest detectable value of each effect's main parameter; None where none would show.

    The response of the probe nearest to SURE, and to what the model's own error may feign on top,
    refitted base projected out, scaled to it. An effect that changes nothing, or whose size would
    lie beyond its bounds, shows at no size.
    """
    sure = float(np.sqrt(DETECTED_SIGMA**2 + 2.0 * (by.least - MIN_GAIN)))
    return {p.candidate.name: None if p.dead else _smallest(about, p, by, sure) for p in probed}


def _smallest(about: Projection, probed: Probed, by: LikelihoodScale, sure: float) -> float | None:
    best: tuple[float, float | None] | None = None
    candidate = probed.candidate
    for group, responses in zip(probed.groups, probed.responses, strict=True):
        form = about.form(about.weigh(responses))
        for i, vector in enumerate(group):
            power = form.curvature[i, i] / by.inefficiency
            if power <= 1e-12:
                continue
            sigma = float(np.sqrt(power))
            moved = [k for k, p in enumerate(candidate.parameters) if vector[k] != p.start]
            p = candidate.parameters[moved[0]]
            size = (vector[moved[0]] - p.start) * sure / sigma
            rank = abs(np.log(sigma / sure))
            if best is None or rank < best[0]:
                best = (float(rank), _possible(p, float(p.start + size)))
    return None if best is None else best[1]


def _possible(p: Parameter, value: float) -> float | None:
    """`value` as files state it, None beyond what is physically possible."""
    return p.stated_value(value) if p.low <= value <= p.high else None
