"""Choice of the held-out runs: one condition in four, and repeats of indispensable
ones.
"""

from collections.abc import Callable, Sequence

import numpy as np

from cell.gap.fitting import Simulate
from cell.gap.fitting.base_fit import effect_responses, projection, stated_estimate
from cell.gap.fitting.crossvalidation import folds
from cell.gap.subject.subject import Subject
from drivers.base.errors import ConfigurationError
from drivers.base.types import Array

# Thresholds by which runs are held out, set by hand.
PERIOD = 4  # one condition in so many, unless the others cannot spare it
# share of the information on an effect that is lost without a condition they need
NEEDED = 0.5
ALONE = 0.9  # the same share, of a condition that alone shows an effect
LEAST_INFORMATION = 1.0  # nats in all runs, of an effect that counts
Loss = Callable[[Sequence[int]], float]


def held_out(
    subject: Subject, simulate: Simulate, requested: Sequence[str] = ()
) -> list[str]:
    """Names of the runs to hold out: those `requested`, or else one condition in four.

    A condition that holds most of the information on some effect is fitted: held out,
    it would hide that effect. Where it alone shows one, the last of its repeats is held
    out; where nothing can be spared, the second condition all the same. How well the
    model fits does not matter.
    """
    names = [run.name for run in subject.runs]
    check(names, requested)
    if requested:
        return list(dict.fromkeys(requested))

    conditions = folds(subject.runs, most=len(names))
    loss = _information_loss(subject, simulate)
    indices = _dispensable_runs(conditions, loss)

    for condition in conditions:
        is_free = len(condition) > 1 and not set(condition) & set(indices)
        if is_free and loss(condition) >= ALONE:
            indices += condition[-1:]

    if not indices and len(conditions) > 1:
        indices = conditions[1]

    return [names[index] for index in indices]


def _dispensable_runs(conditions: Sequence[list[int]], loss: Loss) -> list[int]:
    """Numbers of the runs to hold out: one condition in PERIOD, of small information
    loss.
    """
    indices: list[int] = []
    for first in range(1, len(conditions), PERIOD):
        for condition in (*conditions[first:], *conditions[:first]):
            is_free = not set(condition) & set(indices)
            if is_free and loss([*indices, *condition]) < NEEDED:
                indices += condition
                break
    return indices


def check(names: Sequence[str], requested: Sequence[str]) -> None:
    """Raise ConfigurationError where runs `requested` are not among `names`, or are all
    of them.
    """
    unknown = [name for name in requested if name not in names]
    if unknown:
        raise ConfigurationError(
            f"hold out {unknown[0]}: no such run; allowed: {', '.join(names)}"
        )
    if len(set(requested)) == len(names):
        raise ConfigurationError("all runs are held out; leave some to fit")


def _information_loss(subject: Subject, simulate: Simulate) -> Loss:
    """Function from run numbers to the largest share of information on an effect in
    these runs.

    Information is in nats by which a fit would gain from an effect of a size that
    laboratories report, at the stated values of the base, once this has moved to absorb
    what it can.
    """
    stated = stated_estimate(subject, simulate)
    middle = [
        (candidate, candidate.probes[len(candidate.probes) // 2][0])
        for candidate in subject.scope.candidates
    ]
    responses = stated.by_run(effect_responses(simulate, stated, middle))

    def information(indices: Sequence[int]) -> Array:
        absorbing = projection(stated.on(indices), robustly=False)
        response = np.concatenate([responses[index] for index in indices])
        nats: Array = 0.5 * (response * absorbing.unabsorbed(response)).sum(axis=0)
        return nats

    whole = information(range(len(responses)))
    counts = whole > LEAST_INFORMATION

    def loss(without: Sequence[int]) -> float:
        remaining = [i for i in range(len(responses)) if i not in without]
        if not remaining or not counts.any():
            return float(not remaining)
        return float((1.0 - information(remaining)[counts] / whole[counts]).max())

    return loss
