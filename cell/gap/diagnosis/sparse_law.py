"""What no effect of the library explains, described by a sparse law that is stable over runs.

A description, never a cause: terms of the subject are mixed until the next one gains nothing,
and a term counts as stable when it is chosen on most halves of the runs with one sign
(Meinshausen and Buehlmann 2010, Stability selection).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cell.gap.fitting import normal_equations
from cell.gap.fitting.gauss_newton import Estimate
from cell.gap.fitting.projection import Projection
from cell.gap.selection.likelihood import MIN_GAIN
from cell.gap.selection.screening import Probed
from drivers.types import Array


@dataclass(frozen=True, slots=True)
class Steady:
    """A law has at most so many `terms`; it is steady where they are the same in the share `often`
    of so many `halves` of the runs, drawn at random. Source: set by hand.
    """

    terms: int = 3
    halves: int = 40
    often: float = 0.7


STABILITY = Steady()


@dataclass(frozen=True, slots=True)
class Law:
    """A sparse law: `names` of its terms, `words`, whether it is `stable` over halves of the runs,
    and the share of the misfit that it accounts for.
    """

    names: tuple[str, ...]
    words: str
    stable: bool
    share: float


@dataclass(frozen=True, slots=True)
class _Term:
    name: str
    words: str
    unit: str
    value: float
    response: Array


def describe(
    estimate: Estimate, about: Projection, probed: Sequence[Probed], worth: float,
    rng: np.random.Generator,
) -> Law | None:  # fmt: skip
    """Sparse law of what `estimate` leaves; `worth` samples are one independent sample."""
    terms = _terms(probed)
    if not terms:
        return None
    responses = about.weigh(np.array([t.response for t in terms]).T)
    form = about.form(responses)
    chosen = _forward(form, worth)
    if not chosen:
        return None
    amounts, gain = _amounts(form, chosen)
    stable = _stable(estimate, about, responses, chosen, amounts, rng)
    total = 0.5 * float(about.residual @ about.residual)
    parts = [
        f"{terms[i].value * a:+.3g} {terms[i].unit} x {terms[i].words}"
        for i, a in zip(chosen, amounts, strict=True)
    ]
    names = tuple(terms[i].name for i in chosen)
    return Law(names, " ".join(parts), stable, min(1.0, gain / total) if total > 0 else 0.0)


def _terms(probed: Sequence[Probed]) -> list[_Term]:
    """Each parameter of each term, by its secant at nothing."""
    found = []
    for p in probed:
        for vector, response in zip(p.groups[0], p.responses[0].T, strict=True):
            k = int(np.argmax(np.abs(vector)))
            parameter = p.candidate.parameters[k]
            words = f"{p.candidate.sentence} ({parameter.name})"
            if np.abs(response).max() > 0.0:
                found.append(_Term(p.candidate.name, words, parameter.unit, vector[k], response))
    return found


def _forward(form: normal_equations.Normal, worth: float) -> list[int]:
    """Terms that gain more than the margin each, greedily."""
    chosen: list[int] = []
    reached = 0.0
    while len(chosen) < STABILITY.terms:
        gains = [
            _amounts(form, [*chosen, i])[1] if i not in chosen else -np.inf
            for i in range(len(form.gradient))
        ]
        i = int(np.argmax(gains))
        if gains[i] - reached < MIN_GAIN * worth:
            break
        chosen.append(i)
        reached = gains[i]
    return chosen


def _amounts(form: normal_equations.Normal, chosen: Sequence[int]) -> tuple[Array, float]:
    some = normal_equations.Normal(form.gradient[chosen], form.curvature[np.ix_(chosen, chosen)])
    step = normal_equations.free_step(some)
    return step, normal_equations.decrease(some, step)


def _stable(
    estimate: Estimate, about: Projection, responses: Array, chosen: Sequence[int],
    amounts: Array, rng: np.random.Generator,
) -> bool:  # fmt: skip
    """Whether the same terms win with the same signs on most halves of the runs."""
    runs = len(estimate.residuals)
    owner = np.repeat(np.arange(runs), [len(r) for r in estimate.residuals])
    left = about.left(responses)
    agreed = 0
    for _ in range(STABILITY.halves):
        half = np.isin(owner, rng.permutation(runs)[: max(1, runs // 2)])
        form = normal_equations.Normal(
            responses[half].T @ about.residual[half], responses[half].T @ left[half]
        )
        again, _ = _amounts(form, chosen)
        agreed += bool((np.sign(again) == np.sign(amounts)).all())
    return agreed >= STABILITY.often * STABILITY.halves
