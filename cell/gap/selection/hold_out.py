"""Which runs only judge: one condition in four, and a repeat of one that alone shows an effect."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cell.gap.fitting.crossvalidation import folds
from cell.gap.fitting.gauss_newton import Estimate
from cell.gap.fitting.model import Model, request, response
from cell.gap.fitting.projection import projection
from cell.gap.fitting.starts import nominal
from cell.gap.fitting.tasks import Simulate
from cell.gap.subject.subject import Subject
from drivers.errors import ConfigurationError
from drivers.types import Array


@dataclass(frozen=True, slots=True)
class Sparing:
    """Which runs may be held out. Source: set by hand.

    One condition in `every`, unless the others lose the share `needed` of what all runs say of an
    effect, or `alone` for a condition of which a repeat is held out; an effect of which all runs
    say less than `shown` [nats] has no voice.
    """

    every: int = 4
    needed: float = 0.5
    alone: float = 0.9
    shown: float = 1.0


SPARING = Sparing()


def held_out(subject: Subject, simulate: Simulate, wanted: Sequence[str] = ()) -> list[str]:
    """Names of the runs that only judge: those asked for, or one condition in four.

    A condition that holds most of the information on some effect is fitted: held out, it would
    hide that effect. Where it alone shows one, the last of its repeats judges what the others
    show. How well the model fits has no say in this, only what was done.
    """
    names = [run.name for run in subject.runs]
    check(names, wanted)
    if wanted:
        return list(dict.fromkeys(wanted))
    groups = folds(subject.runs, most=len(names))
    informative, held = Informativeness(subject, simulate), list[int]()
    for first in range(1, len(groups), SPARING.every):
        for group in (*groups[first:], *groups[:first]):
            if (
                not set(group) & set(held)
                and informative.largest_loss([*held, *group]) < SPARING.needed
            ):
                held += group
                break
    for group in groups:
        free = len(group) > 1 and not set(group) & set(held)
        if free and informative.largest_loss(group) >= SPARING.alone:
            held += group[-1:]
    second = (i for group in groups[1:2] for i in group)
    return [names[i] for i in held or second]


def check(names: Sequence[str], wanted: Sequence[str]) -> None:
    """Refuse runs to hold out that are not there, or are all."""
    unknown = [name for name in wanted if name not in names]
    if unknown:
        raise ConfigurationError(
            f"--hold-out {unknown[0]}: no such run; allowed: {', '.join(names)}"
        )
    if len(set(wanted)) == len(names):
        raise ConfigurationError("--hold-out: all runs are held out; leave some to fit")


class Informativeness:
    """Information of runs on the effects of the library, at the stated values of the base.

    Nats by which a fit would gain from an effect of a size that laboratories report, once the
    base has moved to absorb what it can.
    """

    def __init__(self, subject: Subject, simulate: Simulate) -> None:
        self._stated = nominal(subject, simulate)
        self._responses = _responses(subject, simulate, self._stated)
        self._all = self._information(range(len(subject.runs)))

    def largest_loss(self, without: Sequence[int]) -> float:
        """Largest share that is lost, of any effect, without the runs of these numbers."""
        kept = [i for i in range(len(self._responses)) if i not in without]
        shown = self._all > SPARING.shown
        if not kept or not shown.any():
            return float(not kept)
        return float((1.0 - self._information(kept)[shown] / self._all[shown]).max())

    def _information(self, kept: Sequence[int]) -> Array:
        """Information (candidates,) [nats] in the runs of these numbers."""
        about = projection(self._stated.on(kept), robustly=False)
        moved = np.concatenate([self._responses[i] for i in kept])
        return np.asarray(0.5 * (moved * about.left(moved)).sum(axis=0))


def _responses(subject: Subject, simulate: Simulate, base: Estimate) -> list[Array]:
    """Whitened response (n, candidates) of each run to each candidate's middle probe."""
    runs, candidates = base.evidence.runs, subject.scope.candidates
    models = [(base.model, base.shared)]
    for c in candidates:
        (vector, *_) = c.probes[len(c.probes) // 2]
        shared = np.concatenate([base.shared, np.array(vector)])
        models.append((Model(base.model.base, (c,)), shared))
    answers = simulate([
        replace(request(model, run, shared, own), rough=True)
        for model, shared in models
        for run, own in zip(runs, base.point.local, strict=True)
    ])  # fmt: skip
    return [
        np.array([
            response(answers[k * len(runs) + i], answers[i], base.evidence.scales[i])
            for k in range(1, len(models))
        ]).T
        for i in range(len(runs))
    ]  # fmt: skip
