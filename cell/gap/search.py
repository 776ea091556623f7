"""Which effects: single ones, pairs jointly, three at most, each step earned and checked back."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cell.gap import robust
from cell.gap.batch import Simulate, Task, alone, side_by_side, together
from cell.gap.compare import LEVEL, MARGIN, Margin, Yardstick, holm, margin, yardstick
from cell.gap.crossvalidation import Validated, validate
from cell.gap.model import Evidence, Model, Point
from cell.gap.projection import projection
from cell.gap.refit import ROUGHLY, Estimate, refit
from cell.gap.resolved import resolved
from cell.gap.screen import Score, probe, ranked, table
from cell.gap.starts import best, judged
from cell.gap.subject import Candidate
from drivers.types import Array

SINGLES, PAIRS, FURTHER = 5, 3, 4  # models refitted: alone, joint pairs, beside the best
SIFTED, SIFTING = 8, 2  # pairs of which those few are chosen by a fit of so many steps
WORTH = 0.5  # of the best model's gain, from which a rival's law is bent too
GUESS = 1 / 3  # of what is believed of a finer parameter, where its fit begins too
BEGUN = 4  # steps of a fit after which the best of several goes on alone
MATERIAL = 0.25  # of the excess gap that a step must remove


@dataclass(frozen=True, slots=True)
class Step:
    """One level of the search: its best model against what was accepted before.

    `p` is family-wise over the models of the level.
    """

    model: Validated
    before: Validated
    gain: float
    p: float
    removed: float
    accepted: bool


@dataclass(frozen=True, slots=True)
class Found:
    """The outcome: the accepted model (the base where none is), every model tried, the steps."""

    accepted: Validated
    tried: tuple[Validated, ...]
    by: Yardstick
    steps: tuple[Step, ...]


def fit_scores(
    simulate: Simulate, base: Estimate, scores: Sequence[Score], candidates: Sequence[Candidate]
) -> list[Validated]:
    """Screened models refitted with the base, from null and from what the screen found."""
    tasks = []
    for s in scores:
        model, points = _starts(base, s, candidates)
        tasks.append(_fitted(model, base.evidence, points))
    return together(simulate, [validate(e) for e in together(simulate, tasks)])


def sifted(
    simulate: Simulate,
    base: Estimate,
    scores: Sequence[Score],
    candidates: Sequence[Candidate],
    most: int,
) -> list[Score]:
    """The `most` scores whose models come farthest in a few steps, to go on from there.

    Responses are far from linear where one effect of a pair moves what the other one does.
    """
    tasks = []
    for s in scores:
        model, points = _starts(base, s, candidates)
        tasks.append(_begun(model, base.evidence, points[1:] or points))
    done = together(simulate, tasks)
    scale = min((e.scale for e in done), default=1.0)
    order = sorted(range(len(done)), key=lambda i: judged(done[i], scale))
    return [Score(scores[i].names, scores[i].gain, {}, after=done[i]) for i in order[:most]]


def _begun(model: Model, evidence: Evidence, starts: Sequence[Point]) -> Task[Estimate]:
    """The best of the first few steps from each start."""
    fits = [refit(model, evidence, p, enough=ROUGHLY, steps=SIFTING) for p in starts]
    return best((yield from side_by_side(fits)))


def _starts(
    base: Estimate, score: Score, candidates: Sequence[Candidate]
) -> tuple[Model, list[Point]]:
    """The model of a score, and the points where its fits begin."""
    model = with_effects(base.model, score.names, candidates)
    origin = score.after or base
    shared, _ = origin.model.split(origin.shared)
    return model, [Point(model.joined(shared, v), origin.point.local) for v in score.starts]


def _fitted(model: Model, evidence: Evidence, starts: Sequence[Point]) -> Task[Estimate]:
    """A few steps from each start, and from where they came farthest to the end."""
    begun = [refit(model, evidence, p, enough=ROUGHLY, steps=BEGUN) for p in starts]
    first = best((yield from side_by_side(begun)))
    done = yield from refit(model, evidence, first.point, first.jacobians, ROUGHLY)
    return best([first, done])


def with_effects(model: Model, names: Sequence[str], candidates: Sequence[Candidate]) -> Model:
    """The base model with the named effects, in the order of the library."""
    return Model(model.base, tuple(c for c in candidates if c.name in names))


def bent(simulate: Simulate, pool: Sequence[Validated]) -> list[Validated]:
    """The best models of the size of the best one with their finer parameters free, where that
    is earned: a specimen seldom obeys a law of the library to the letter.
    """
    by = yardstick(pool)
    base = next(m for m in pool if not m.model.effects)
    first = _sorted(pool, by)[0]
    size, least = len(first.model.effects), WORTH * margin(first, base, by).gain
    rivals = [m for m in pool if size and len(m.model.effects) == size and _bends(m.model)]
    worth = [m for m in rivals if margin(m, base, by).gain > least]
    tasks = []
    for m in worth:
        fit, model = m.estimate, _bent(m.model)
        shared, effects = fit.model.split(fit.shared)
        points = [Point(model.joined(shared, v), fit.point.local) for v in _guesses(model, effects)]
        tasks.append(_fitted(model, fit.evidence, points))
    done = together(simulate, [validate(e) for e in together(simulate, tasks)])
    return [new for m, new in zip(worth, done, strict=True) if _better(new, m, by)]


def _bends(model: Model) -> bool:
    return any(e.finer for e in model.effects)


def _bent(model: Model) -> Model:
    return replace(model, effects=tuple(e.bent() if e.finer else e for e in model.effects))


def _guesses(model: Model, effects: Mapping[str, Array]) -> list[dict[str, Array]]:
    """The values with the finer parameters at their start, and off it by GUESS of what is
    believed of them: at the start itself some do nothing yet.
    """
    whole = {e.name: e.completed(effects[e.name]) for e in model.effects}
    moved = {}
    for e in model.effects:
        added = np.array([GUESS * p.spread for p in e.parameters])
        added[: len(effects[e.name])] = 0.0
        moved[e.name] = whole[e.name] + added
    return [whole, moved]


def _better(new: Validated, plain: Validated, by: Yardstick) -> bool:
    ahead = margin(new, plain, by)
    return ahead.gain > by.least and ahead.p < LEVEL


def with_bent(candidates: Sequence[Candidate], pool: Sequence[Validated]) -> list[Candidate]:
    """The candidates, bent where a single one was worth it."""
    known = {e.name: e for m in pool if len(m.model.effects) == 1 for e in m.model.effects}
    return [known.get(c.name, c) for c in candidates]


def extended(
    simulate: Simulate, pool: Sequence[Validated], size: int, candidates: Sequence[Candidate]
) -> list[Score]:
    """The best model of `size` effects with each of the most promising others beside it.

    Screened from where that model was fitted: responses to a further effect at the base mean
    little where the first one is strong.
    """
    rivals = _sorted([m for m in pool if len(m.model.effects) == size], yardstick(pool))
    if not rivals:
        return []
    fit = rivals[0].estimate
    others = [c for c in candidates if c.name not in fit.model.names]
    probed = together(simulate, [probe(fit, c) for c in others])
    return [s.beside(fit) for s in ranked(table(projection(fit), probed))[:FURTHER]]


def without_each(pool: Sequence[Validated]) -> list[Score]:
    """The accepted model and the best one without each of their effects, to begin from where they
    were fitted: beside another effect a fit may have left a local minimum.
    """
    found = choose(pool)
    best = _sorted(pool, found.by)[0]
    scores = []
    for model in [found.accepted] if best is found.accepted else [found.accepted, best]:
        names, fit = sorted(model.model.names), model.estimate
        if len(names) > 1:
            less = [tuple(n for n in names if n != gone) for gone in names]
            scores += [Score(kept, 0.0, {}, after=fit) for kept in less]
    return scores


def better_base(simulate: Simulate, pool: Sequence[Validated]) -> Estimate | None:
    """The base refitted from the values that the accepted model gave it, where that is better.

    A base that had stopped in a local minimum leaves a gap that is none.
    """
    accepted = choose(pool).accepted.estimate
    base = next(m for m in pool if not m.model.effects).estimate
    if not accepted.model.effects:
        return None
    values, _ = accepted.model.split(accepted.shared)
    again = alone(simulate, refit(base.model, base.evidence, Point(values, accepted.point.local)))
    scale = min(base.scale, again.scale)
    return again if judged(again, scale) < judged(base, scale) - MARGIN else None


def merged(pool: Sequence[Validated], more: Sequence[Validated]) -> list[Validated]:
    """Every model once: of two fits of the same effects the better one."""
    found = {m.model.names: m for m in pool}
    for m in more:
        known = found.get(m.model.names)
        if known is None or best([known.estimate, m.estimate]) is m.estimate:
            found[m.model.names] = m
    return list(found.values())


def choose(pool: Sequence[Validated]) -> Found:
    """The largest model of which every effect is earned."""
    by = yardstick(pool)
    accepted = next(m for m in pool if not m.model.effects)
    steps = []
    for level in (1, 2, 3):
        rivals = _sorted([m for m in pool if len(m.model.effects) == level], by)
        if not rivals:
            continue
        step = _step(rivals, accepted, pool, by)
        steps.append(step)
        if step.accepted:
            accepted = step.model
    return Found(accepted, tuple(pool), by, tuple(steps))


def only_sure(found: Found, classes: Sequence[Sequence[str]]) -> Found:
    """Accepting the effects that no other stands in for, where they are worth it by themselves."""
    doubtful = {name for group in classes for name in group}
    sure = found.accepted.model.names - doubtful
    if not doubtful or not sure:
        return found
    base = next(m for m in found.tried if not m.model.effects)
    for model in found.tried:
        if model.model.names == sure and _earned(margin(model, base, found.by), found.by.least):
            return replace(found, accepted=model)
    return found


def _earned(ahead: Margin, needed: float) -> bool:
    return ahead.gain > needed and ahead.p < LEVEL and ahead.removed > MATERIAL


def _step(
    rivals: Sequence[Validated], before: Validated, pool: Sequence[Validated], by: Yardstick
) -> Step:
    margins = [margin(m, before, by) for m in rivals]
    p = holm([m.p for m in margins])[0]
    first, needed = margins[0], _asked(before, pool, by)
    good = _earned(replace(first, p=p), needed) and all(
        _needed(rivals[0], e.name, pool, by) and resolved(rivals[0].estimate, e, by)
        for e in rivals[0].model.effects
    )
    return Step(rivals[0], before, first.gain, p, first.removed, good)


def exhausted(pool: Sequence[Validated]) -> bool:
    """Whether all that the accepted model leaves beyond noise is less than a further effect must
    gain, so that none could be accepted; in the nats of one that leaves nothing but noise, which
    is what most samples show: a generous floor leaves less than it states.
    """
    found = choose(pool)
    accepted, ideal = found.accepted, replace(found.by, scale=1.0, inefficiency=1.0)
    if not accepted.model.effects:
        return False
    noise = 0.5 * sum(len(r) * robust.spread(r) ** 2 for r in accepted.left_out)
    left = float(accepted.losses(ideal.scale).sum()) - noise
    return left < _asked(accepted, pool, ideal)


def _needed(model: Validated, effect: str, pool: Sequence[Validated], by: Yardstick) -> bool:
    """Backward check: the model without the effect, where it was tried, predicts worse."""
    without = [m for m in pool if m.model.names == model.model.names - {effect}]
    if not without or not model.model.names - {effect}:
        return True
    return _earned(margin(model, without[0], by), _asked(without[0], pool, by))


def _asked(model: Validated, pool: Sequence[Validated], by: Yardstick) -> float:
    """Nats that count as a further effect beside `model`: what its effects' laws get wrong of
    what it explains, another effect would take up.
    """
    if not model.model.effects:
        return by.least
    base = next(m for m in pool if not m.model.effects)
    gained = max(0.0, margin(model, base, by).gain)
    return by.least + max(e.untrue for e in model.model.effects) * gained


def _sorted(models: Sequence[Validated], by: Yardstick) -> list[Validated]:
    return sorted(models, key=lambda m: (float(m.losses(by.scale).sum()), m.model.name))
