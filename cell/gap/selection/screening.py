"""Screening: how much each candidate could explain, judged by probes from the refitted base."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import TypeGuard

import numpy as np
from numpy.typing import NDArray

from cell.gap.fitting import normal_equations
from cell.gap.fitting.gauss_newton import Estimate
from cell.gap.fitting.model import Model, Point, request, response
from cell.gap.fitting.projection import Projection
from cell.gap.fitting.tasks import Task
from cell.gap.selection.likelihood import LikelihoodScale
from cell.gap.subject.subject import Candidate
from drivers.types import Array

Start = tuple[Point, tuple[Array, ...] | None]
"""Where a fit begins, and the whitened secants (n, shared + local) of each run there, if known."""
Columns = NDArray[np.int64]
DETECTED_SIGMA = 8.0  # at which cross-validation, too, accepts an effect; set by hand
LEAST_POWER = 1e-12  # squared norm of a whitened response; a smaller one is rounding


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
        starts: list[dict[str, Array]] = [{}]
        if not self.linear:
            starts.append(self.start)
        starts += self.tried
        if self.mirrored is not None:
            starts.append(self.mirrored)
        return [{**self._known, **values} for values in starts]

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
    origin_point, *others = (Point(model.join(shared, v), origin.point.local) for v in score.starts)
    secants = _secants(origin, model, score) if origin.evidence is base.evidence else None
    return model, [(origin_point, secants), *((p, None) for p in others)]


def with_effects(model: Model, names: Sequence[str], candidates: Sequence[Candidate]) -> Model:
    """The base of `model` with the named effects, in the order of `candidates`."""
    return Model(model.base, tuple(c for c in candidates if c.name in names))


def _secants(origin: Estimate, model: Model, score: Score) -> tuple[Array, ...] | None:
    """Secants (n, shared + local) by run of `model` at `origin`, a fit with fewer effects.

    None where one of the effects was not screened there.
    """
    count, base = len(origin.shared), len(model.base)
    stacked = np.concatenate([jacobian[:, :count] for jacobian in origin.jacobians])
    by_effect, column = dict(score.secants), base
    for effect in origin.model.effects:
        by_effect[effect.name] = stacked[:, column : column + len(effect.parameters)]
        column += len(effect.parameters)
    secants = [by_effect.get(e.name) for e in model.effects]
    complete = [f for f, e in zip(secants, model.effects, strict=True) if _is_complete(f, e)]
    if len(complete) < len(secants) or not origin.model.names <= model.names:
        return None
    shared = np.concatenate([stacked[:, :base], *complete], axis=1)
    edges = np.cumsum([len(jacobian) for jacobian in origin.jacobians])[:-1]
    return tuple(
        np.concatenate([rows, jacobian[:, count:]], axis=1)
        for rows, jacobian in zip(np.split(shared, edges), origin.jacobians, strict=True)
    )


def _is_complete(secants: Array | None, effect: Candidate) -> TypeGuard[Array]:
    """Whether there is a secant for each of the effect's parameters."""
    return secants is not None and secants.shape[1] == len(effect.parameters)


@dataclass(frozen=True, slots=True)
class Reach:
    """Limits within which a screen trusts responses to probes. Source: set by hand.

    A response is extrapolated to `farthest` times its probe; an unscaled probe is a start where it
    gains the `least_share` of the best mix. Two responses differ by at least the share `alike` of
    their square. An effect whose response per amount near null is below the share `steep` of that
    farther off has a threshold; one of a whitened response below `dead` changes nothing.
    """

    farthest: float = 3.0
    least_share: float = 0.3
    alike: float = 1e-10
    steep: float = 0.3
    dead: float = 1e-6


DEFAULT_REACH = Reach()


@dataclass(frozen=True, slots=True)
class ProbeResponses:
    """A candidate's groups of probes with the whitened responses (N, members) to each group.

    The first group are steps from the null, one parameter at a time, the others the candidate's
    own probes.
    """

    candidate: Candidate
    groups: tuple[tuple[Array, ...], ...]
    responses: tuple[Array, ...]

    @property
    def secants(self) -> Array:
        """Whitened secants (N, parameters) at the null."""
        moved = np.array([v - self.candidate.null for v in self.groups[0]])
        return np.asarray(self.responses[0] / np.diag(moved))

    @property
    def dead(self) -> bool:
        """Whether the candidate changes nothing in these runs."""
        return all(np.abs(d).max(initial=0.0) < DEFAULT_REACH.dead for d in self.responses)


def probe(base: Estimate, candidate: Candidate, *, steps: bool = True) -> Task[ProbeResponses]:
    """Simulate the probes of a candidate at the refitted base; yields simulations.

    Without `steps` from the null, which a linear screen needs, only its own probes.
    """
    model = Model(base.model.base, (*base.model.effects, candidate))
    probes = tuple(tuple(candidate.complete(np.array(v)) for v in g) for g in candidate.probes)
    groups = (_steps_from_null(candidate), *probes) if steps else probes
    vectors = [v for group in groups for v in group]
    runs, local = base.evidence.runs, base.point.local
    requests = [
        replace(request(model, run, np.concatenate([base.shared, v]), unknowns), response=True)
        for v in (candidate.null, *vectors)
        for run, unknowns in zip(runs, local, strict=True)
    ]
    answers = yield requests
    at_null, columns = answers[: len(runs)], []
    for k in range(1, len(vectors) + 1):
        at_probe = answers[k * len(runs) : (k + 1) * len(runs)]
        rows = zip(at_probe, at_null, base.evidence.scales, strict=True)
        columns.append(np.concatenate([response(*row) for row in rows]))
    responses, offset = [], 0
    for group in groups:
        responses.append(np.array(columns[offset : offset + len(group)]).T)
        offset += len(group)
    return ProbeResponses(candidate, groups, tuple(responses))


def _steps_from_null(candidate: Candidate) -> tuple[Array, ...]:
    """Parameter vectors (k,), each at null but for one parameter, which is a step away."""
    moved = []
    for i, p in enumerate(candidate.parameters):
        vector = candidate.null
        vector[i] += p.step if p.start + p.step <= p.high else -p.step
        moved.append(vector)
    return tuple(moved)


@dataclass(frozen=True, slots=True)
class Table:
    """Normal equations of the refitted objective in the amounts of all candidates' probes.

    `form` is in the amounts of all columns; `columns` (candidate, group) are their positions.
    `together` (G, G) is what two of these groups could gain at most [nats], in their order.
    """

    probed: tuple[ProbeResponses, ...]
    form: normal_equations.Normal
    columns: dict[tuple[str, int], Columns]
    together: Array

    def most(self, members: Sequence[ProbeResponses]) -> Array:
        """Largest gain [nats] of one candidate by group (groups,), of two (groups, groups)."""
        order = list(self.columns)
        rows = [[order.index((p.candidate.name, g)) for g in range(len(p.groups))] for p in members]
        if len(rows) == 1:
            return np.asarray(np.diag(self.together)[rows[0]])
        return np.asarray(self.together[np.ix_(*rows)])


def table(projection: Projection, probed: Sequence[ProbeResponses]) -> Table:
    """Table of the probes of every candidate that changes something."""
    alive = tuple(p for p in probed if not p.dead)
    columns: dict[tuple[str, int], Columns] = {}
    column = 0
    for p in alive:
        for group, responses in enumerate(p.responses):
            columns[p.candidate.name, group] = np.arange(column, column + responses.shape[1])
            column += responses.shape[1]
    parts = [projection.weigh(response) for p in alive for response in p.responses]
    stacked = np.concatenate(parts, axis=1) if parts else np.zeros((len(projection.residual), 0))
    form = projection.form(stacked)
    return Table(alive, form, columns, _most_together(form, list(columns.values())))


def ranking(equations: Table) -> list[Score]:
    """Scores of all candidates that change something, the largest gain first."""
    scores = [_score(equations, (p,)) for p in equations.probed]
    return sorted(scores, key=lambda s: (-s.gain, s.names))


def ranked_pairs(equations: Table, among: int, least: float = 0.0) -> list[Score]:
    """Scores of the best `among` pairs of candidates that gain over `least` [nats], best first.

    Two effects whose responses nearly cancel gain nothing alone and much together, so that pairs
    are screened over all candidates, not over the best single ones. Pairs are looked at closely
    in the order of what they could gain without bounds, until no other can be among the best.
    """
    pairs = combinations(equations.probed, 2)
    bounds = [(float(equations.most(pair).max()), pair) for pair in pairs]
    scores: list[Score] = []
    for most, pair in sorted(bounds, key=lambda each: -each[0]):
        if most <= least or (len(scores) >= among and most < scores[among - 1].gain):
            break
        scores = sorted([*scores, _score(equations, pair)], key=lambda s: (-s.gain, s.names))
    return [s for s in scores[:among] if s.gain > least]


def _most_together(form: normal_equations.Normal, groups: Sequence[Columns]) -> Array:
    """Gain (G, G) [nats] without bounds of each two groups of columns, of one on the diagonal.

    A second group gains by the Schur complement of the first: what that one does not explain.
    """
    gradient, curvature = form.gradient, form.curvature
    first = np.array([columns[0] for columns in groups], dtype=np.int64)
    wide = [b for b, columns in enumerate(groups) if len(columns) > 1]
    most = np.zeros((len(groups), len(groups)))
    for a, columns in enumerate(groups):
        inverse = _inverse(curvature[np.ix_(columns, columns)])
        across = curvature[:, columns] @ inverse
        slope = gradient - across @ gradient[columns]
        spare = np.diag(curvature) - (across * curvature[:, columns]).sum(axis=1)
        is_independent = spare > DEFAULT_REACH.alike * np.diag(curvature)
        single = 0.5 * slope**2 * is_independent / np.where(is_independent, spare, 1.0)
        most[a] = single[first]  # right for groups of one column; wider ones follow
        for b in (b for b in wide if b > a):
            other = groups[b]
            schur = curvature[np.ix_(other, other)]
            schur = schur - across[other] @ curvature[np.ix_(columns, other)]
            most[a, b] = 0.5 * float(slope[other] @ _inverse(schur) @ slope[other])
        most[a, a] = 0.0
        most[a] += 0.5 * float(gradient[columns] @ inverse @ gradient[columns])
    return np.asarray(np.triu(most) + np.triu(most, 1).T)


def _inverse(matrix: Array) -> Array:
    """Inverse of a small symmetric matrix; of one number, its reciprocal."""
    if matrix.shape == (1, 1):
        return np.asarray(1.0 / np.maximum(matrix, 1e-300))
    return np.asarray(np.linalg.pinv(matrix, rcond=1e-10, hermitian=True))


def _score(equations: Table, members: Sequence[ProbeResponses]) -> Score:
    """Score of the best mix of probes of one or more candidates, over all choices of groups.

    The amounts solve the bounded quadratic programme of the refitted objective: one-sided where
    physics fixes the sign. Groups are tried in the order of what they could gain, until no other
    can be better.
    """
    best, values_at_best = Score(tuple(p.candidate.name for p in members), 0.0, {}), {}
    probe_gain, best_probe = 0.0, dict[str, Array]()  # of probes as they are, unscaled
    bounds = equations.most(members)
    for bound, choice in sorted(zip(-bounds.ravel(), np.ndindex(bounds.shape), strict=True)):
        worthwhile = DEFAULT_REACH.least_share * best.gain
        if -bound <= min(best.gain, max(probe_gain, worthwhile)):
            break
        mix, gain, values = _best_mix(equations, members, choice)
        if mix.gain > best.gain:
            best, values_at_best = mix, values
        if gain > probe_gain and all(choice):  # group 0 holds steps, which are no probes
            probe_gain, best_probe = gain, values
    if probe_gain <= DEFAULT_REACH.least_share * best.gain:
        best_probe = values_at_best if any(_has_threshold(p) for p in members) else {}
    return replace(
        best,
        tried=_probes_to_fit(members, best_probe),
        mirrored=_other_sign(equations, members[0], best) if len(members) == 1 else None,
        secants={p.candidate.name: p.secants for p in members},
    )


def _probes_to_fit(
    members: Sequence[ProbeResponses], unscaled: dict[str, Array]
) -> tuple[dict[str, Array], ...]:
    """Values of the probes to fit from: `unscaled` or, of one effect with a threshold, every probe.

    Beyond its threshold, the response to one probe says little of that to another: from the probe
    that the linear screen prefers, no step may lead to the best value.
    """
    if len(members) == 1 and _has_threshold(members[0]):
        name, (_, *probes) = members[0].candidate.name, members[0].groups
        return tuple({name: vector} for group in probes for vector in group)
    return (unscaled,) if unscaled else ()


def _has_threshold(p: ProbeResponses) -> bool:
    """Whether an effect responds far less per amount at its smallest probe than at larger ones.

    False for a two-sided effect with a place: its response may be larger at another place.
    """
    if p.candidate.two_sided and _shapes(p.candidate).any():
        return False
    amounts = [abs(float(group[0][0] - p.candidate.null[0])) for group in p.groups]
    smallest, *larger = (
        float(np.linalg.norm(response[:, 0])) / amount if amount else 0.0
        for amount, response in zip(amounts, p.responses, strict=True)
    )
    return smallest < DEFAULT_REACH.steep * max(larger, default=0.0)


def _other_sign(equations: Table, p: ProbeResponses, best: Score) -> dict[str, Array] | None:
    """Values of an effect at the place where it gains most with the sign opposite to `best`.

    None where it has no place, or gains with one sign alone.
    """
    name, null = p.candidate.name, p.candidate.null[0]
    if name not in best.start or not _shapes(p.candidate).any():
        return None
    mixes = [_best_mix(equations, (p,), (group,))[0] for group in range(1, len(p.groups))]
    sign = np.sign(best.start[name][0] - null)
    others = [score for score in mixes if sign * (score.start[name][0] - null) < 0.0]
    return max(others, key=lambda score: score.gain).start if others else None


def _best_mix(
    equations: Table, members: Sequence[ProbeResponses], choice: tuple[int, ...]
) -> tuple[Score, float, dict[str, Array]]:
    """Score of the best mix of the groups `choice`; gain and values of their unscaled probes."""
    names = tuple(p.candidate.name for p in members)
    chosen = list(zip(members, choice, strict=True))
    columns = np.concatenate([equations.columns[p.candidate.name, group] for p, group in chosen])
    reach = [
        _reach(p.candidate, vector) if group == 0 else DEFAULT_REACH.farthest
        for p, group in chosen
        for vector in p.groups[group]
    ]
    signed = [_has_mirror(p.candidate, v) for p, group in chosen for v in p.groups[group]]
    high, zero = np.array(reach), np.zeros(len(columns))
    gradient, curvature = equations.form.gradient, equations.form.curvature
    form = normal_equations.Normal(gradient[columns], curvature[np.ix_(columns, columns)])
    limits = normal_equations.Bounds(np.where(signed, -high, 0.0), high, zero, zero)
    amounts = normal_equations.bounded_step(form, zero, limits)
    gain = normal_equations.decrease(form, amounts)
    unscaled = np.where(amounts < 0.0, -1.0, 1.0)
    return (
        Score(names, gain, _values(chosen, amounts), not any(choice)),
        normal_equations.decrease(form, unscaled),
        _values(chosen, unscaled),
    )


def _reach(candidate: Candidate, vector: Array) -> float:
    """Largest multiple of a step from null that stays within the bounds."""
    moved = vector - candidate.null
    ends = [
        abs((p.high if d > 0 else p.low) - p.start) / abs(d)
        for p, d in zip(candidate.parameters, moved, strict=True)
        if d != 0.0
    ]
    return min(ends, default=DEFAULT_REACH.farthest)


def _has_mirror(candidate: Candidate, vector: Array) -> bool:
    """Whether the mirrored probe is within bounds, so that both signs are possible."""
    mirrored = np.where(_shapes(candidate), vector, 2.0 * candidate.null - vector)
    low, high = _ends(candidate)
    return bool(((mirrored >= low) & (mirrored <= high)).all())


def _shapes(candidate: Candidate) -> NDArray[np.bool_]:
    """Mask (k,) of the shape parameters, which are no amounts."""
    return np.array([p.shape for p in candidate.parameters])


def _ends(candidate: Candidate) -> tuple[Array, Array]:
    parameters = candidate.parameters
    return np.array([p.low for p in parameters]), np.array([p.high for p in parameters])


def _values(chosen: Sequence[tuple[ProbeResponses, int]], amounts: Array) -> dict[str, Array]:
    """Parameter values (k,) by effect of the probes mixed in `amounts` (probes,)."""
    values, k = {}, 0
    for p, group in chosen:
        value, shapes = p.candidate.null, _shapes(p.candidate)
        for vector in p.groups[group]:
            scaled = value + amounts[k] * (vector - p.candidate.null)
            value = np.where(shapes, vector, scaled)
            k += 1
        values[p.candidate.name] = np.clip(value, *_ends(p.candidate))
    return values


def detectable(
    projection: Projection, probed: Sequence[ProbeResponses], likelihood: LikelihoodScale
) -> dict[str, float | None]:
    """Smallest detectable value of each effect's main parameter; None where none would show.

    The probe whose response, less what `projection` may absorb, is nearest to DETECTED_SIGMA is
    scaled to it. An effect that changes nothing, or whose size would lie beyond its bounds, shows
    at no size.
    """
    return {
        p.candidate.name: None if p.dead else _smallest(projection, p, likelihood) for p in probed
    }


def _smallest(
    projection: Projection, probed: ProbeResponses, likelihood: LikelihoodScale
) -> float | None:
    """Detectable value of an effect's main parameter, by the probe that shows nearest to it."""
    sizes: list[tuple[float, float | None]] = []
    for group, responses in zip(probed.groups, probed.responses, strict=True):
        curvature = projection.form(projection.weigh(responses)).curvature
        power = np.diag(curvature) / likelihood.inefficiency
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
