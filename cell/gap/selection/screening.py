"""Linear screening: predicts what candidate effects gain, from simulations near the
base fit.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations, islice
from operator import itemgetter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cell.gap.fitting import Task
from cell.gap.fitting.base_fit import Projection
from cell.gap.fitting.gauss_newton import FitEstimate, responses_to
from cell.gap.fitting.model import Model, Point
from cell.gap.fitting.normal_equations import NormalEquations
from cell.gap.selection.likelihood import LikelihoodScale
from cell.gap.subject.subject import Candidate
from drivers.base.types import Array

Start = tuple[Point, Sequence[Array] | None]
"""Where a fit begins, and the whitened secants (n, shared + local) of each run there,
if known.
"""
Columns = NDArray[np.int64]
DETECTED_SIGMA = 8.0  # at which cross-validation, too, accepts an effect; set by hand
LEAST_POWER = 1e-12  # squared norm of a whitened response; a smaller one is rounding
DEAD = 1e-6  # largest whitened response of an effect that changes nothing
# Limits of linear extrapolation from probes, set by hand.
FARTHEST = 3.0  # times a stated probe, to which it is scaled
LEAST_SHARE = 0.3  # of the gain of the best mix, of an unscaled probe that is a start
# times the response per amount farther off, below which an effect has a threshold
STEEP = 0.3


@dataclass(frozen=True, slots=True)
class Score:
    """Predicted gain [nats] of effects that are added together, and values to start
    their fit from.

    The gain is that at the values `start`, by effect. Where these are `linear`, they
    follow from the secants at null, and a fit from null finds them by itself.
    `probe_starts` are unscaled probes, for effects that do nothing below a threshold,
    so that a scaled probe may be no start. `opposite_sign` is a start for an effect
    with a place: elsewhere the other sign may leave the same response. `origin` is the
    fit to extend, the base if None. `secants` (N, parameters) by effect are whitened,
    at null.
    """

    names: tuple[str, ...]
    gain: float
    start: dict[str, Array]
    linear: bool = True
    probe_starts: tuple[dict[str, Array], ...] = ()
    opposite_sign: dict[str, Array] | None = None
    origin: FitEstimate | None = None
    secants: Mapping[str, Array] = field(default_factory=dict)

    @property
    def starts(self) -> list[dict[str, Array]]:
        """Start values (k,) by effect for each fit that is to be tried; effects without
        one start at null.
        """
        starts: list[dict[str, Array]] = [{}]
        if not self.linear:
            starts.append(self.start)
        starts += self.probe_starts
        if self.opposite_sign:
            starts.append(self.opposite_sign)
        return [{**self._origin_values, **values} for values in starts]

    def joined_to(self, fit: FitEstimate) -> "Score":
        """Copy of the score that adds its effects to those of `fit`, and starts from
        the values of that fit.
        """
        names = tuple(sorted({*fit.names, *self.names}))
        return replace(self, names=names, origin=fit)

    @property
    def _origin_values(self) -> dict[str, Array]:
        """Values (k,) of this score's effects in the fit `origin` that it extends, by
        effect; empty without one.
        """
        if not self.origin:
            return {}
        _, effects = self.origin.values
        return {name: values for name, values in effects.items() if name in self.names}


def fit_starts(
    base: FitEstimate, score: Score, candidates: Sequence[Candidate]
) -> tuple[Model, list[Start]]:
    """Model with the effects of `score`, and starts of its fits: first with new effects
    at null.

    Shape parameters that are free in the fit that is extended stay so. Only the first
    start has a Jacobian: that of this fit and, for new effects, the one of the screen.
    A fit computes it anew where it does not predict the decrease.
    """
    origin = score.origin or base
    held = {effect.name: effect for effect in origin.effects}
    versions = (
        (candidate, held.get(candidate.name, candidate)) for candidate in candidates
    )
    freest = [max(both, key=lambda effect: len(effect.parameters)) for both in versions]
    model = _with_effects(base.model, score.names, freest)
    shared, _ = origin.values
    origin_point, *others = (
        Point(model.join(shared, v), origin.local) for v in score.starts
    )
    secants = _secants(origin, model, score) if origin.runs is base.runs else None
    return model, [(origin_point, secants), *((p, None) for p in others)]


def _with_effects(
    model: Model, names: Sequence[str], candidates: Sequence[Candidate]
) -> Model:
    """Model of the base of `model` and those of `candidates` that have `names`, in
    their order.
    """
    return Model(
        model.base,
        tuple(candidate for candidate in candidates if candidate.name in names),
    )


def _secants(origin: FitEstimate, model: Model, score: Score) -> Sequence[Array] | None:
    """Jacobian (samples, unknowns) of each run for `model`, from `origin` with fewer
    effects; None where one of the effects was not screened there.
    """
    jacobians = origin.jacobians
    count = len(origin.shared)
    stacked = np.concatenate([jacobian[:, :count] for jacobian in jacobians])
    base, of_origin = origin.model.split(stacked.T)
    by_effect = {name: secants.T for name, secants in score.secants.items()} | of_origin
    rows = [by_effect.get(effect.name, stacked[:0]) for effect in model.effects]
    sizes = [len(effect.parameters) for effect in model.effects]
    if [*map(len, rows)] != sizes or not origin.names <= model.names:
        return None

    shared = origin.by_run(np.concatenate([base, *rows]).T)
    return [
        np.concatenate([of_shared, jacobian[:, count:]], axis=1)
        for of_shared, jacobian in zip(shared, jacobians, strict=True)
    ]


class ProbeResponses(NamedTuple):
    """Whitened responses (samples, probes) of all runs to each group of a candidate
    effect's probes.

    The first group holds steps from null, one parameter at a time; the others are the
    candidate's stated probes.
    """

    candidate: Candidate
    groups: tuple[tuple[Array, ...], ...]
    responses: tuple[Array, ...]

    @property
    def name(self) -> str:
        """Name of the candidate effect."""
        return self.candidate.name

    @property
    def secants(self) -> Array:
        """Derivatives (samples, parameters) of the whitened residuals by the effect's
        parameters at its null.
        """
        moved = np.array([v - self.candidate.null for v in self.groups[0]])
        slopes: Array = self.responses[0] / np.diag(moved)
        return slopes

    @property
    def dead(self) -> bool:
        """Whether the effect changes nothing in the measured runs at any of
        its probes.
        """
        return all(
            np.abs(response).max(initial=0.0) < DEAD for response in self.responses
        )

    @property
    def has_threshold(self) -> bool:
        """Whether the effect responds far less, per amount, to its smallest probe than
        to others.

        By the first probe of each group. False for a two-sided effect with a place: its
        response may be larger at another place.
        """
        candidate = self.candidate
        if candidate.two_sided and _shape_mask(candidate).any():
            return False
        amounts = [abs(group[0][0] - candidate.null[0]) for group in self.groups]
        smallest, *larger = (
            np.linalg.norm(response[:, 0]) / amount if amount else 0.0
            for amount, response in zip(amounts, self.responses, strict=True)
        )
        return smallest < STEEP * max(larger, default=0.0)


def run_probes(base: FitEstimate, candidate: Candidate) -> Task[ProbeResponses]:
    """Simulate an effect's probes at the fit `base` and return the responses; a task
    that yields simulation requests.
    """
    model = Model(base.model.base, (*base.effects, candidate))
    probes = tuple(
        tuple(candidate.complete(np.array(v)) for v in g) for g in candidate.probes
    )
    groups = (_steps_from_null(candidate), *probes)
    vectors = [candidate.null, *(v for group in groups for v in group)]
    by_run = yield from responses_to(
        base, [(model, np.append(base.shared, vector)) for vector in vectors]
    )
    columns = iter([np.concatenate(each) for each in by_run])
    stacked = [np.array(list(islice(columns, len(group)))).T for group in groups]
    return ProbeResponses(candidate, groups, tuple(stacked))


def _steps_from_null(candidate: Candidate) -> tuple[Array, ...]:
    """Parameter vectors (k,) of an effect, each a step from its null in one
    parameter.
    """
    moved = []
    for i, p in enumerate(candidate.parameters):
        vector = candidate.null
        vector[i] += p.step if p.start + p.step <= p.high else -p.step
        moved.append(vector)
    return tuple(moved)


class ProbeEquations(NamedTuple):
    """Normal equations for the amounts of the probes of all candidate effects, the base
    refitted.

    `columns` by candidate and group are the positions of its probes in `form`.
    """

    probed: tuple[ProbeResponses, ...]
    form: NormalEquations
    columns: dict[tuple[str, int], Columns]


def probe_equations(
    projection: Projection, probed: Sequence[ProbeResponses]
) -> ProbeEquations:
    """Normal equations for the amounts of the probes of each candidate that changes
    something.
    """
    alive = tuple(p for p in probed if not p.dead)
    columns: dict[tuple[str, int], Columns] = {}
    column = 0
    parts = [np.zeros((len(projection.residual), 0))]

    for p in alive:
        for group, response in enumerate(p.responses):
            first = column
            column = column + len(response.T)
            columns[p.name, group] = np.arange(first, column)
            parts.append(projection.weigh(response))

    form = projection.form(np.concatenate(parts, axis=1))
    return ProbeEquations(alive, form, columns)


def ranked_singles(equations: ProbeEquations) -> list[Score]:
    """Scores of the single effects that change the runs at all, the largest gain
    first.
    """
    scores = [_score(equations, (p,)) for p in equations.probed]
    return sorted(scores, key=lambda s: (-s.gain, s.names))


def ranked_pairs(
    equations: ProbeEquations, among: int, least: float = 0.0
) -> list[Score]:
    """Scores of the best `among` pairs of effects whose gain is over `least` [nats],
    the largest gain first.

    Two effects whose responses nearly cancel gain little alone and much together, so
    that all pairs compete, not those of the best single ones.
    """
    scores = [_score(equations, pair) for pair in combinations(equations.probed, 2)]
    scores.sort(key=lambda s: (-s.gain, s.names))
    return [score for score in scores[:among] if score.gain > least]


def _score(equations: ProbeEquations, members: Sequence[ProbeResponses]) -> Score:
    """Score of the candidates `members` together, by the best mix of one group of
    probes of each.

    The amounts solve a quadratic programme, one-sided where physics fixes the sign.
    """
    best = Score(tuple(member.name for member in members), gain=0.0, start={})
    values_at_best: dict[str, Array] = {}
    best_probe: dict[str, Array] = {}  # as it is, unscaled
    probe_gain = 0.0
    for choice in np.ndindex(*(len(member.groups) for member in members)):
        mix, gain, values = _best_mix(equations, members, choice)
        if mix.gain > best.gain:
            best = mix
            values_at_best = values
        # group 0 holds steps, which are no probes
        if gain > probe_gain and all(choice):
            probe_gain = gain
            best_probe = values

    if probe_gain <= LEAST_SHARE * best.gain:
        best_probe = (
            values_at_best if any(member.has_threshold for member in members) else {}
        )

    return replace(
        best,
        probe_starts=_probes_to_fit(members, best_probe),
        opposite_sign=(
            _opposite_sign(equations, members[0], best) if len(members) == 1 else None
        ),
        secants={member.name: member.secants for member in members},
    )


def _probes_to_fit(
    members: Sequence[ProbeResponses], unscaled: dict[str, Array]
) -> tuple[dict[str, Array], ...]:
    """Further starts (k,) by effect: all probes of a threshold effect, else the mix
    `unscaled`.

    Beyond a threshold the response is not linear: from the probe that the screen
    prefers, no step of a fit may lead to the best value.
    """
    first, *others = members
    if first.has_threshold and not others:
        _, *probes = first.groups
        return tuple({first.name: vector} for group in probes for vector in group)
    return (unscaled,) if unscaled else ()


def _opposite_sign(
    equations: ProbeEquations, p: ProbeResponses, best: Score
) -> dict[str, Array] | None:
    """Parameter values (k,) by effect that gain most with the sign opposite to `best`.

    None where the effect has no place, or gains with one sign only.
    """
    name = p.name
    candidate = p.candidate
    if name not in best.start or not _shape_mask(candidate).any():
        return None
    mixes = [
        _best_mix(equations, (p,), (group,))[0] for group in range(1, len(p.groups))
    ]

    def moved(score: Score) -> float:
        return float(score.start[name][0] - candidate.null[0])

    others = [score for score in mixes if moved(best) * moved(score) < 0.0]
    return max(others, key=lambda score: score.gain).start if others else None


def _best_mix(
    equations: ProbeEquations,
    members: Sequence[ProbeResponses],
    choice: tuple[int, ...],
) -> tuple[Score, float, dict[str, Array]]:
    """Score of the best mix of probe groups `choice`; gain and values (k,) at amounts 1
    or -1.
    """
    names = tuple(member.name for member in members)
    chosen = list(zip(members, choice, strict=True))
    columns = np.concatenate([equations.columns[p.name, group] for p, group in chosen])

    low = []
    high = []
    for p, group in chosen:
        for vector in p.groups[group]:
            reach = FARTHEST if group else _largest_multiple(p.candidate, vector)
            low.append(-reach if _allows_both_signs(p.candidate, vector) else 0.0)
            high.append(reach)

    gradient, curvature = equations.form
    form = NormalEquations(gradient[columns], curvature[np.ix_(columns, columns)])
    amounts = form.bounded_step(np.array(low), np.array(high))
    unscaled = np.where(amounts < 0.0, -1.0, 1.0)
    return (
        Score(
            names=names,
            gain=form.decrease(amounts),
            start=_mixed_values(chosen, amounts),
            linear=not any(choice),
        ),
        form.decrease(unscaled),
        _mixed_values(chosen, unscaled),
    )


def _largest_multiple(candidate: Candidate, vector: Array) -> float:
    """Largest factor on the step from null to `vector` (k,) that stays within the
    bounds.
    """
    moved = vector - candidate.null
    ends = [
        ((p.high if d > 0 else p.low) - p.start) / d
        for p, d in zip(candidate.parameters, moved, strict=True)
        if d != 0.0
    ]
    return min(ends, default=FARTHEST)


def _allows_both_signs(candidate: Candidate, vector: Array) -> bool:
    """Whether the probe `vector` (k,) with its sign reversed is within the parameters'
    bounds.
    """
    mirrored = np.where(_shape_mask(candidate), vector, 2.0 * candidate.null - vector)
    return np.array_equal(mirrored, np.clip(mirrored, *_bounds(candidate)))


def _shape_mask(candidate: Candidate) -> NDArray[np.bool_]:
    """Mask (k,) of the parameters of shape, such as a place or a width, that no amount
    scales.
    """
    return np.array([not p.is_amount for p in candidate.parameters])


def _bounds(candidate: Candidate) -> tuple[Array, Array]:
    """Lowest and highest values (k,) of the parameters of `candidate`."""
    low, high = np.array([(p.low, p.high) for p in candidate.parameters]).T
    return low, high


def _mixed_values(
    chosen: Sequence[tuple[ProbeResponses, int]], amounts: Array
) -> dict[str, Array]:
    """Parameter values (k,) by effect: null plus each of the probes `chosen` times its
    amount.
    """
    values = {}
    following = iter(amounts)
    for p, group in chosen:
        candidate = p.candidate
        null = candidate.null
        shapes = _shape_mask(candidate)
        value = null
        for vector in p.groups[group]:
            scaled = value + next(following) * (vector - null)
            value = np.where(shapes, vector, scaled)
        values[p.name] = np.clip(value, *_bounds(candidate))
    return values


def detection_limits(
    projection: Projection,
    probed: Sequence[ProbeResponses],
    likelihood: LikelihoodScale,
) -> dict[str, float | None]:
    """Smallest detectable amount of each effect by name, in its first parameter's unit,
    or None.

    It is the value at which its response would have DETECTED_SIGMA once the base is
    refitted.
    """
    return {
        p.name: (None if p.dead else _detection_limit(projection, p, likelihood))
        for p in probed
    }


def _detection_limit(
    projection: Projection, probed: ProbeResponses, likelihood: LikelihoodScale
) -> float | None:
    """Smallest detectable amount of one effect, scaled linearly from its most
    detectable probe.

    Probes of parameters in another unit than the first one's do not count. None where
    the limit lies beyond a bound, or no probe changes anything.
    """
    parameters = probed.candidate.parameters
    # each with the logarithm of its scaling
    limits: list[tuple[float, float | None]] = []
    for vectors, responses in zip(probed.groups, probed.responses, strict=True):
        powers = np.diag(projection.form(projection.weigh(responses)).curvature)
        powers = powers / likelihood.inefficiency
        for vector, power in zip(vectors, powers, strict=True):
            moved = vector - probed.candidate.null
            i = int(np.flatnonzero(moved)[0])
            p = parameters[i]  # moved by this probe
            if power > LEAST_POWER and p.unit == parameters[0].unit:
                factor = DETECTED_SIGMA / np.sqrt(power)
                limit = p.start + float(moved[i]) * factor
                stated = p.stated_value(limit) if p.low <= limit <= p.high else None
                limits.append((abs(np.log(factor)), stated))

    _, nearest = min(limits, key=itemgetter(0), default=(0.0, None))
    return nearest
