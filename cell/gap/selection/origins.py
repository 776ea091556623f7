"""Where the fits of a screened model begin, and what is known there of its responses."""

from collections.abc import Sequence
from typing import TypeGuard

import numpy as np

from cell.gap.fitting.gauss_newton import Estimate
from cell.gap.fitting.model import Model, Point
from cell.gap.selection.score import Score
from cell.gap.subject.subject import Candidate
from drivers.types import Array

Start = tuple[Point, tuple[Array, ...] | None]
"""Where a fit begins, and the whitened secants (n, shared + local) of each run there, if known."""


def starts(
    base: Estimate, score: Score, candidates: Sequence[Candidate]
) -> tuple[Model, list[Start]]:
    """The model of a score, and where its fits begin: the first at null of what is new.

    There the secants are those of the fit that it goes on from, and for what is new those that it
    was screened by: a fit looks anew where they do not keep what they promise.
    """
    model = with_effects(base.model, score.names, candidates)
    origin = score.after or base
    shared, _ = origin.model.split(origin.shared)
    first, *others = (Point(model.join(shared, v), origin.point.local) for v in score.starts)
    known = _secants(origin, model, score) if origin.evidence is base.evidence else None
    return model, [(first, known), *((p, None) for p in others)]


def with_effects(model: Model, names: Sequence[str], candidates: Sequence[Candidate]) -> Model:
    """The base model with the named effects, in the order of the library."""
    return Model(model.base, tuple(c for c in candidates if c.name in names))


def _secants(origin: Estimate, model: Model, score: Score) -> tuple[Array, ...] | None:
    """Secants of each run at the fit `origin`, of a `model` that has more effects; None where one
    of them was not screened there.
    """
    count, base = len(origin.shared), len(model.base)
    whole = np.concatenate([jacobian[:, :count] for jacobian in origin.jacobians])
    by_effect, at = dict(score.secants), base
    for effect in origin.model.effects:
        by_effect[effect.name] = whole[:, at : at + len(effect.parameters)]
        at += len(effect.parameters)
    found = [by_effect.get(e.name) for e in model.effects]
    known = [f for f, e in zip(found, model.effects, strict=True) if _fits(f, e)]
    if len(known) < len(found) or not origin.model.names <= model.names:
        return None
    shared = np.concatenate([whole[:, :base], *known], axis=1)
    edges = np.cumsum([len(jacobian) for jacobian in origin.jacobians])[:-1]
    return tuple(
        np.concatenate([some, jacobian[:, count:]], axis=1)
        for some, jacobian in zip(np.split(shared, edges), origin.jacobians, strict=True)
    )


def _fits(secants: Array | None, effect: Candidate) -> TypeGuard[Array]:
    """Whether there is a secant for each of the effect's parameters."""
    return secants is not None and secants.shape[1] == len(effect.parameters)
