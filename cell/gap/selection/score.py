"""Screening score of a few effects together, and the starts of their fits."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeGuard

import numpy as np

from cell.gap.fitting.gauss_newton import Estimate
from cell.gap.fitting.model import Model, Point
from cell.gap.subject.subject import Candidate
from drivers.types import Array

Start = tuple[Point, tuple[Array, ...] | None]
"""Where a fit begins, and the whitened secants (n, shared + local) of each run there, if known."""


@dataclass(frozen=True, slots=True)
class Score:
    """Effects screened together: their gain [nats] at the values `start` by name.

    `linear`: found by the secants at null, which a fit from null follows by itself. `tried` are
    the values of probes as they are: an effect with a threshold does nothing below it, so that a
    share of a probe is no start. `mirrored` is a start of the other sign, of an
    effect that has a place: elsewhere it may do with one sign what it does here with the other.
    `after` is a fit from whose values and effects to start. `secants` (N, parameters) by name are
    whitened, at null.
    """

    names: tuple[str, ...]
    gain: float
    start: dict[str, Array]
    linear: bool = True
    tried: tuple[dict[str, Array], ...] = ()
    mirrored: dict[str, Array] | None = None
    after: Estimate | None = None
    secants: Mapping[str, Array] = field(default_factory=dict)

    @property
    def starts(self) -> list[dict[str, Array]]:
        """Start values (k,) by effect of each fit to try; missing effects start at null."""
        found: list[dict[str, Array]] = [{}]
        if not self.linear:
            found.append(self.start)
        found += self.tried
        if self.mirrored is not None:
            found.append(self.mirrored)
        return [{**self._known, **values} for values in found]

    def joined_to(self, fit: Estimate) -> "Score":
        """Score of these effects and those of `fit`, to start from it."""
        names = tuple(sorted({*fit.model.names, *self.names}))
        return replace(self, names=names, after=fit)

    @property
    def _known(self) -> dict[str, Array]:
        if self.after is None:
            return {}
        _, effects = self.after.model.split(self.after.shared)
        return {name: values for name, values in effects.items() if name in self.names}


def starts(
    base: Estimate, score: Score, candidates: Sequence[Candidate]
) -> tuple[Model, list[Start]]:
    """Model of `score` and the starts of its fits, the first with new effects at null.

    The secants there are those of the fit that it starts from, and for new effects those of the
    screen: a fit takes new ones where they do not predict its decrease.
    """
    model = with_effects(base.model, score.names, candidates)
    origin = score.after or base
    shared, _ = origin.model.split(origin.shared)
    first, *others = (Point(model.join(shared, v), origin.point.local) for v in score.starts)
    known = _secants(origin, model, score) if origin.evidence is base.evidence else None
    return model, [(first, known), *((p, None) for p in others)]


def with_effects(model: Model, names: Sequence[str], candidates: Sequence[Candidate]) -> Model:
    """The base of `model` with the named effects, in the order of `candidates`."""
    return Model(model.base, tuple(c for c in candidates if c.name in names))


def _secants(origin: Estimate, model: Model, score: Score) -> tuple[Array, ...] | None:
    """Secants (n, shared + local) by run of `model` at `origin`, a fit with fewer effects.

    None where one of the effects was not screened there.
    """
    count, base = len(origin.shared), len(model.base)
    whole = np.concatenate([jacobian[:, :count] for jacobian in origin.jacobians])
    by_effect, at = dict(score.secants), base
    for effect in origin.model.effects:
        by_effect[effect.name] = whole[:, at : at + len(effect.parameters)]
        at += len(effect.parameters)
    found = [by_effect.get(e.name) for e in model.effects]
    known = [f for f, e in zip(found, model.effects, strict=True) if _is_complete(f, e)]
    if len(known) < len(found) or not origin.model.names <= model.names:
        return None
    shared = np.concatenate([whole[:, :base], *known], axis=1)
    edges = np.cumsum([len(jacobian) for jacobian in origin.jacobians])[:-1]
    return tuple(
        np.concatenate([some, jacobian[:, count:]], axis=1)
        for some, jacobian in zip(np.split(shared, edges), origin.jacobians, strict=True)
    )


def _is_complete(secants: Array | None, effect: Candidate) -> TypeGuard[Array]:
    """Whether there is a secant for each of the effect's parameters."""
    return secants is not None and secants.shape[1] == len(effect.parameters)
