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
    """Responses of a candidate's groups of probes: one array (N, members) each, whitened.

    The first group are the secants at the null, one parameter at a time, the others the
    candidate's own probes.
    """

    candidate: Candidate
    groups: tuple[tuple[Array, ...], ...]
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
    groups = (_secants(candidate), *(tuple(map(np.array, g)) for g in candidate.probes))
    vectors = [v for group in groups for v in group]
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
    for group in groups:
        responses.append(np.array(columns[at : at + len(group)]).T)
        at += len(group)
    return Probed(candidate, groups, tuple(responses))


def _secants(candidate: Candidate) -> tuple[Array, ...]:
    """The null with one parameter moved by its step, each."""
    moved = []
    for i, p in enumerate(candidate.parameters):
        vector = candidate.null
        vector[i] += p.step if p.start + p.step <= p.high else -p.step
        moved.append(vector)
    return tuple(moved)


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
    columns, low, high = [], [], []
    for p, group in zip(probed, choice, strict=True):
        columns.append(p.responses[group])
        for vector in p.groups[group]:
            reach = _reach(p.candidate, vector) if group == 0 else FARTHEST
            high.append(reach)
            low.append(-reach if _mirrored(p.candidate, vector) else 0.0)
    responses = about.weighed(np.concatenate(columns, axis=1))
    form = about.form(responses)
    k = len(low)
    limits = quadratic.Bounds(np.array(low), np.array(high), np.zeros(k), np.zeros(k))
    amounts = quadratic.bounded_step(form, np.zeros(k), limits)
    gain = quadratic.decrease(form, amounts)
    return Score(tuple(p.candidate.name for p in probed), gain, _values(probed, choice, amounts))


def _reach(candidate: Candidate, vector: Array) -> float:
    """Times a secant to the bound: it stands for the response at null."""
    moved = vector - candidate.null
    ends = [
        abs((p.high if d > 0 else p.low) - p.start) / abs(d)
        for p, d in zip(candidate.parameters, moved, strict=True)
        if d != 0.0
    ]
    return min(ends, default=FARTHEST)


def _mirrored(candidate: Candidate, vector: Array) -> bool:
    """Whether the mirrored probe is within bounds, so that both signs are possible."""
    mirrored = 2.0 * candidate.null - vector
    low = np.array([p.low for p in candidate.parameters])
    high = np.array([p.high for p in candidate.parameters])
    return bool(((mirrored >= low) & (mirrored <= high)).all())


def _values(probed: Sequence[Probed], choice: tuple[int, ...], amounts: Array) -> dict[str, Array]:
    values, at = {}, 0
    for p, group in zip(probed, choice, strict=True):
        value = p.candidate.null
        for vector in p.groups[group]:
            value = value + amounts[at] * (vector - p.candidate.null)
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
