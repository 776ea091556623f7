"""Where the effects of a fitted model show in what the base leaves."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cell.gap.diagnosis.localise import Bin, rows_by_bin, standardise
from cell.gap.fitting import robust
from cell.gap.fitting.gauss_newton import Estimate
from drivers.types import Array


def shown_places(
    base: Estimate, fitted: Estimate, others: Sequence[Estimate], noise: Array, allowed: Array
) -> list[Bin]:
    """All bins, strongest first, by how well the base's residuals there match what the model
    `fitted` adds.

    Each sample counts by what the model says otherwise than the base (matched filter), against
    `noise` (N, draws), divided by what is `allowed` (N,) beyond it. The model was chosen in sight
    of the residuals, so that a draw counts by its strongest bin under the response of any of the
    models tried, this one and `others`, with either sign (Westfall and Young 1993).
    """
    r = np.concatenate(base.residuals)
    weight = (r - np.concatenate(fitted.residuals)) / allowed
    bins = rows_by_bin(base)
    rows = list(bins.values())
    found, drawn = _match_sums(robust.clip_residuals(r / allowed), weight, rows, noise)
    largest = np.abs(drawn).max(axis=0)
    for other in others:
        tried = (r - np.concatenate(other.residuals)) / allowed
        largest = np.maximum(largest, np.abs(_match_sums(r, tried, rows, noise)[1]).max(axis=0))
    places = []
    for (key, at), z in zip(bins.items(), found, strict=True):
        p = (1.0 + float((largest >= z).sum())) / (1.0 + len(largest))
        side = 1.0 if weight[at].sum() >= 0.0 else -1.0
        places.append(Bin(*key, side * float(z), p))
    return sorted(places, key=lambda place: (place.p, -abs(place.z)))


def surer_of_two(by_itself: Sequence[Bin], by_effect: Sequence[Bin]) -> list[Bin]:
    """Each bin by the surer of two tests, strongest first; probabilities allow for both."""
    if not by_effect:
        return list(by_itself)
    other = {_key(b): b for b in by_effect}
    surer = [min(b, other[_key(b)], key=lambda one: one.p) for b in by_itself]
    both = [replace(b, p=min(1.0, 2.0 * b.p)) for b in surer]
    return sorted(both, key=lambda place: -abs(place.z))


def _key(b: Bin) -> tuple[str, str, str, str]:
    return b.channel, b.phase, b.zone, b.condition


def _match_sums(
    r: Array, weight: Array, rows: Sequence[list[int]], noise: Array
) -> tuple[Array, Array]:
    """Standardised sums over bins of `r` (N,) and of `noise` (N, draws), both weighted (N,)."""
    return standardise(
        np.array([r[i] @ weight[i] for i in rows]), np.array([weight[i] @ noise[i] for i in rows])
    )
