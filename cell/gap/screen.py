"""Screening: how much each candidate could explain, judged by probes from the refitted base."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from cell.gap import quadratic
from cell.gap.batch import Task
from cell.gap.model import LOST, Model, request
from cell.gap.projection import Projection
from cell.gap.refit import Estimate
from cell.gap.subject import Candidate
from drivers.types import Array

FARTHEST = 3.0  # times a probe to which its response is extrapolated
DEAD = 1e-6  # whitened response below which an effect changes nothing


@dataclass(frozen=True, slots=True)
class Probed:
    """Responses of a candidate's groups of probes: one array (N, members) each, whitened."""

    candidate: Candidate
    responses: tuple[Array, ...]

    @property
    def dead(self) -> bool:
        """Whether it changes nothing in these runs."""
        return all(np.abs(d).max(initial=0.0) < DEAD for d in self.responses)


@dataclass(frozen=True, slots=True)
class Score:
    """Effects screened together: nats gained at `start`, their values by name."""

    names: tuple[str, ...]
    gain: float
    start: dict[str, Array]


def probe(base: Estimate, candidate: Candidate) -> Task[Probed]:
    """Responses of a candidate's probes at the refitted base; yields simulations."""
    model = Model(base.model.base, (*base.model.effects, candidate))
    vectors = [np.array(v) for group in candidate.probes for v in group]
    runs, local = base.evidence.runs, base.point.local
    asked = [
        request(model, run, np.concatenate([base.shared, v]), own)
        for v in vectors
        for run, own in zip(runs, local, strict=True)
    ]
    answers = yield asked
    columns = []
    for k in range(len(vectors)):
        mine = answers[k * len(runs) : (k + 1) * len(runs)]
        parts = [
            np.nan_to_num((a.mean - b.mean) / s, nan=LOST, posinf=LOST, neginf=-LOST)
            for a, b, s in zip(mine, base.raw, base.evidence.scales, strict=True)
        ]
        columns.append(np.concatenate(parts))
    responses, at = [], 0
    for group in candidate.probes:
        responses.append(np.array(columns[at : at + len(group)]).T)
        at += len(group)
    return Probed(candidate, tuple(responses))


def score(about: Projection, probed: Sequence[Probed]) -> Score:
    """Best mix of the probes of one or more candidates, over their groups.

    The amounts solve the bounded quadratic programme of the refitted objective: one-sided where
    physics fixes the sign.
    """
    best = Score(tuple(p.candidate.name for p in probed), 0.0, {})
    for choice in _choices([len(p.responses) for p in probed]):
        found = _mixed(about, probed, choice)
        if found.gain > best.gain:
            best = found
    return best


def _choices(sizes: Sequence[int]) -> list[tuple[int, ...]]:
    grid = np.indices(tuple(sizes)).reshape(len(sizes), -1).T
    return [tuple(map(int, row)) for row in grid]


def _mixed(about: Projection, probed: Sequence[Probed], choice: tuple[int, ...]) -> Score:
    columns, low = [], []
    for p, group in zip(probed, choice, strict=True):
        columns.append(p.responses[group])
        low += [_lowest(p.candidate, np.array(v)) for v in p.candidate.probes[group]]
    responses = about.weighed(np.concatenate(columns, axis=1))
    form = about.form(responses)
    k = len(low)
    limits = quadratic.Bounds(np.array(low), np.full(k, FARTHEST), np.zeros(k), np.zeros(k))
    amounts = quadratic.bounded_step(form, np.zeros(k), limits)
    gain = quadratic.decrease(form, amounts)
    return Score(tuple(p.candidate.name for p in probed), gain, _values(probed, choice, amounts))


def _lowest(candidate: Candidate, vector: Array) -> float:
    """-FARTHEST where the mirrored probe is within bounds, else 0."""
    mirrored = 2.0 * candidate.null - vector
    low = np.array([p.low for p in candidate.parameters])
    high = np.array([p.high for p in candidate.parameters])
    return -FARTHEST if bool(((mirrored >= low) & (mirrored <= high)).all()) else 0.0


def _values(probed: Sequence[Probed], choice: tuple[int, ...], amounts: Array) -> dict[str, Array]:
    values, at = {}, 0
    for p, group in zip(probed, choice, strict=True):
        value = p.candidate.null
        for vector in p.candidate.probes[group]:
            value = value + amounts[at] * (np.array(vector) - p.candidate.null)
            at += 1
        low = np.array([q.low for q in p.candidate.parameters])
        high = np.array([q.high for q in p.candidate.parameters])
        values[p.candidate.name] = np.clip(value, low, high)
    return values


def ranked(about: Projection, probed: Sequence[Probed]) -> list[Score]:
    """All candidates that change something, the most promising first."""
    scores = [score(about, [p]) for p in probed if not p.dead]
    return sorted(scores, key=lambda s: (-s.gain, s.names))


def ranked_pairs(about: Projection, probed: Sequence[Probed], among: int) -> list[Score]:
    """Pairs of candidates, the most promising first.

    Two effects whose responses nearly cancel gain nothing alone and much together, so that pairs
    are screened over all candidates, not over the best single ones.
    """
    alive = [p for p in probed if not p.dead]
    scores = [score(about, list(pair)) for pair in combinations(alive, 2)]
    return sorted(scores, key=lambda s: (-s.gain, s.names))[:among]
