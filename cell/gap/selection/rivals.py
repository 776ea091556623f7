"""Models that these runs cannot distinguish from the accepted one."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cell.gap.fitting.crossvalidation import Validated
from cell.gap.selection.fits import Fits
from cell.gap.selection.likelihood import ALPHA
from cell.gap.selection.posterior import Posterior

LAW_ERROR = 0.02  # of a lead in nats: square of 15 %, by which responses are wrong; set by hand
EXPLAINED = 0.5  # of what an effect gains, that may be missing in its rival; set by hand
PRESENT = 0.5  # inclusion probability from which an effect is rather there than not


@dataclass(frozen=True, slots=True)
class Alternative:
    """A rival of the accepted model, and the nats by which it is `behind`."""

    model: Validated
    behind: float


def rivals(accepted: Validated, fits: Fits, sets: Posterior) -> list[Alternative]:
    """Models that explain the runs about as well as the accepted one, and more probable ones."""
    return [*probable_rivals(accepted, fits, sets), *more_probable(accepted, fits, sets)]


def probable_rivals(accepted: Validated, fits: Fits, sets: Posterior) -> list[Alternative]:
    """Models of as many effects as the accepted one that the posterior does not exclude.

    Excluded is what is less than ALPHA times as probable, beyond what errors of laws may decide.
    """
    others = [_alternative(accepted, m, sets) for m in fits.of_size(len(accepted.model.effects))]
    found = [
        r
        for r in others
        if r.model is not accepted and r.behind < -np.log(ALPHA) + _law_error(accepted, r, sets)
    ]
    return sorted(found, key=lambda r: r.behind)


def _law_error(accepted: Validated, rival: Alternative, sets: Posterior) -> float:
    """Nats by which a rival may be behind `accepted` though it is true, since no law is exact.

    The share LAW_ERROR of what the accepted set gains over the base, but at most the share
    EXPLAINED of what is gained by the effects that the rival lacks: what the rival has in their
    place must gain the rest.
    """
    names = accepted.model.names
    lead, shared = sets.lead(names), names & rival.model.model.names
    fitted = {m.names for m in sets.models}
    gain = lead - sets.lead(shared) if shared in fitted else lead
    return max(0.0, min(LAW_ERROR * lead, EXPLAINED * gain))


def _alternative(accepted: Validated, other: Validated, sets: Posterior) -> Alternative:
    return Alternative(other, sets.lead(accepted.model.names) - sets.lead(other.model.names))


def more_probable(accepted: Validated, fits: Fits, sets: Posterior) -> list[Alternative]:
    """For each improbable accepted effect, the most probable fitted model without it.

    The model of no effect does not count: whether there is a gap at all is decided elsewhere.
    """
    found = []
    doubted = (e for e in accepted.model.names if sets.inclusion[e] < PRESENT)
    for effect in sorted(doubted):
        names = next(m.names for m in sets.models if effect not in m.names)
        other = fits.of(names)
        if names and other is not None:
            found.append(_alternative(accepted, other, sets))
    return found


def classes(accepted: Validated, found: Sequence[Alternative]) -> list[list[str]]:
    """Classes of effects, by name, that the runs cannot separate from one another.

    Rivals that differ in one effect give the class of the two effects; those that share none
    give one class of all.
    """
    mine = accepted.model.names
    merged: list[set[str]] = []
    for rival in found:
        group = set(mine ^ rival.model.model.names)
        touching = [g for g in merged if g & group]
        for g in touching:
            group |= g
            merged.remove(g)
        merged.append(group)
    return sorted(sorted(g) for g in merged)
