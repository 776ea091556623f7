"""Models that these runs cannot distinguish from the accepted one."""

from collections.abc import Sequence
from dataclasses import dataclass

from cell.gap.fitting.crossvalidation import Validated
from cell.gap.selection.fits import Fits
from cell.gap.selection.likelihood import ALPHA, MIN_GAIN, LikelihoodScale, margin
from cell.gap.selection.posterior import Posterior


@dataclass(frozen=True, slots=True)
class Distinction:
    """Thresholds that separate an effect from its rivals. Source: set by hand.

    Fitted predictions differ by `distance` [sigma], and the effect is rather there than not: its
    probability of `inclusion` is at least this.
    """

    distance: float = 3.0
    inclusion: float = 0.5


DISTINCTION = Distinction()


@dataclass(frozen=True, slots=True)
class Alternative:
    """A rival of the accepted model, and the nats by which it is `behind`."""

    model: Validated
    behind: float


def rivals(
    accepted: Validated, fits: Fits, by: LikelihoodScale, believed: Posterior | None = None
) -> list[Alternative]:
    """Models of as many effects as the accepted one that the runs do not separate or refute.

    Where a posterior is `believed`, it refutes, too, models that are far less probable than the
    accepted one.
    """
    base, found = fits.base, []
    needed = by.ahead(margin(accepted, base, by).gain)
    for other in fits.models:
        same = len(other.model.effects) == len(accepted.model.effects)
        if not same or other.model.names == accepted.model.names:
            continue
        ahead = margin(accepted, other, by)
        refuted = ahead.gain > needed and ahead.p < ALPHA
        if believed is not None:
            lead = believed.lead(accepted.model.names) - believed.lead(other.model.names)
            refuted |= lead > needed
        worth = margin(other, base, by).gain > MIN_GAIN
        if worth and (ahead.distance < DISTINCTION.distance or not refuted):
            found.append(Alternative(other, ahead.gain))
    return sorted(found, key=lambda r: r.behind)


def probable_rivals(accepted: Validated, fits: Fits, sets: Posterior) -> list[Alternative]:
    """Models of as many effects as the accepted one that are about as probable, or more so."""
    others = [_beside(accepted, m, sets) for m in fits.of_size(len(accepted.model.effects))]
    found = [r for r in others if r.model is not accepted and r.behind < MIN_GAIN]
    return sorted(found, key=lambda r: r.behind)


def _beside(accepted: Validated, other: Validated, sets: Posterior) -> Alternative:
    return Alternative(other, sets.lead(accepted.model.names) - sets.lead(other.model.names))


def more_probable(accepted: Validated, fits: Fits, sets: Posterior) -> list[Alternative]:
    """For each improbable accepted effect, the most probable fitted model without it.

    The model of no effect does not count: whether there is a gap at all is decided elsewhere.
    """
    found = []
    doubted = (e for e in accepted.model.names if sets.inclusion[e] < DISTINCTION.inclusion)
    for effect in sorted(doubted):
        names = next(m.names for m in sets.models if effect not in m.names)
        other = fits.of(names)
        if names and other is not None:
            found.append(_beside(accepted, other, sets))
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
