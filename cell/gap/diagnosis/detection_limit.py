"""Detection limits: the smallest size of each effect that these runs would have shown."""

from collections.abc import Sequence

import numpy as np

from cell.gap.fitting.projection import Projection
from cell.gap.selection.likelihood import LikelihoodScale
from cell.gap.selection.screening import Probed
from cell.gap.subject.subject import Candidate
from drivers.types import Array

DETECTED_SIGMA = 8.0  # at which cross-validation, too, accepts an effect; set by hand
LEAST_POWER = 1e-12  # squared norm of a whitened response; a smaller one is rounding


def detectable(
    about: Projection, probed: Sequence[Probed], by: LikelihoodScale
) -> dict[str, float | None]:
    """Smallest detectable value of each effect's main parameter; None where none would show.

    The probe whose response, what `about` may absorb projected out, is nearest to DETECTED_SIGMA is
    scaled to it. An effect that changes nothing, or whose size would lie beyond its bounds, shows
    at no size.
    """
    return {p.candidate.name: None if p.dead else _smallest(about, p, by) for p in probed}


def _smallest(about: Projection, probed: Probed, by: LikelihoodScale) -> float | None:
    """Detectable value of an effect's main parameter, by the probe that shows nearest to it."""
    sizes: list[tuple[float, float | None]] = []
    for group, responses in zip(probed.groups, probed.responses, strict=True):
        power = np.diag(about.form(about.weigh(responses)).curvature) / by.inefficiency
        for vector, square in zip(group, power, strict=True):
            if square > LEAST_POWER:
                sigma = float(np.sqrt(square))
                factor = DETECTED_SIGMA / sigma
                sizes.append((abs(np.log(factor)), _value_at(probed.candidate, vector, factor)))
    return min(sizes, key=lambda each: each[0])[1] if sizes else None


def _value_at(candidate: Candidate, probe: Array, factor: float) -> float | None:
    """Main value of a probe moved `factor` times as far from null; None out of bounds."""
    k, p = next((k, p) for k, p in enumerate(candidate.parameters) if probe[k] != p.start)
    value = float(p.start + (probe[k] - p.start) * factor)
    return p.stated_value(value) if p.low <= value <= p.high else None
