"""Scores verdicts against the key."""

import math
from collections.abc import Iterable, Sequence
from itertools import product
from typing import Literal

from cell.gap.effect_size import indistinguishable_from
from cell.gap.verdict.schema import (
    Interval,
    Kind as VerdictKind,
    NamedEffect,
    Verdict,
    VerdictEvidence,
)
from drivers.base.settings import Settings
from drivers.strip.effects import registry
from drivers.strip.file import StripFile
from tests.lab.exam.case import Case
from tests.lab.studies.study import Values

Result = Literal[
    "right_strict", "right_class", "partly", "wrong_name", "abstained",
    "false_alarm", "gap_claimed", "correct_no_gap", "correct_abstention",
]  # fmt: skip
RIGHT_RESULTS: tuple[Result, ...] = ("right_strict", "right_class")


class Comparison(Settings):
    """Comparison of an estimated parameter with its true value.

    `error` is relative to the truth's distance from the null, None where that is zero;
    `switch` where the parameter says how much of an effect there is.
    """

    name: str
    truth: float
    value: float
    low: float | None
    high: float | None
    error: float | None
    switch: bool = False

    @property
    def covered(self) -> bool:
        """Whether the interval contains the truth; an open end contains everything."""
        above = self.low is None or self.low <= self.truth
        return above and (self.high is None or self.truth <= self.high)


class Outcome(Settings):
    """Score of a case: the `result` of its verdict, with the facts that reports show.

    `realised` is the excess gap after the base was refitted.
    """

    verdict: VerdictKind
    named: tuple[str, ...]
    classes: tuple[tuple[str, ...], ...]
    result: Result
    confidence: float | None
    realised: float
    base: tuple[Comparison, ...]
    parameters: tuple[Comparison, ...]
    runtime: float


def score(verdict: Verdict, case: Case, strip: StripFile) -> Outcome:
    """Score a verdict on the runs of `case`, whose strip file is `strip`."""
    named = tuple(effect.name for effect in verdict.effects)
    return Outcome(
        verdict=verdict.verdict,
        named=named,
        classes=tuple(map(tuple, verdict.ambiguous)),
        result=result(verdict, case),
        confidence=min((e.confidence for e in verdict.effects), default=None),
        realised=verdict.gap.before["excess"],
        base=tuple(_base(verdict, case, strip)),
        parameters=tuple(_effects(verdict, case)),
        runtime=verdict.runtime,
    )


def result(verdict: Verdict, case: Case) -> Result:
    """Classify a verdict as one of nine results, given the hidden causes of `case`."""
    named = frozenset(effect.name for effect in verdict.effects)
    if case.kind == "nothing":
        return _score_empty(verdict, named)
    if case.kind == "outside":
        return _score_foreign(verdict)
    answer = frozenset(case.answer)
    if not named:
        return _score_classes(verdict.ambiguous, answer)
    found = _score_names(named, answer)
    doubtful = frozenset(name for group in verdict.ambiguous for name in group)
    return "right_class" if found == "partly" and answer <= named | doubtful else found


def _score_empty(verdict: Verdict, named: frozenset[str]) -> Result:
    if verdict.verdict == "no_gap":
        return "correct_no_gap"
    return "false_alarm" if named else "gap_claimed"


def _score_foreign(verdict: Verdict) -> Result:
    """Result for a cause outside the library: right only if the gap is found but not
    explained.
    """
    if verdict.verdict == "unexplained":
        return "correct_abstention"
    return "abstained" if verdict.verdict == "no_gap" else "wrong_name"


def _score_names(named: frozenset[str], answer: frozenset[str]) -> Result:
    """Result of named effects: wrong with a false name, partly right with one of two
    effects.
    """
    if named == answer:
        return "right_strict"
    if named in with_twins(answer):
        return "right_class"
    parts = [part for whole in with_twins(answer) for part in whole]
    return "partly" if len(answer) > 1 and named <= set(parts) else "wrong_name"


def _score_classes(classes: Iterable[Sequence[str]], answer: frozenset[str]) -> Result:
    """Result of ambiguous classes: right if they hold the whole answer, partly if one
    of a pair.
    """
    held = answer & {name for group in classes for name in group}
    if answer and held == answer:
        return "right_class"
    return "partly" if held else "abstained"


def with_twins(answer: frozenset[str]) -> list[frozenset[str]]:
    """All variants of the answer in which effects are replaced by indistinguishable
    ones.
    """
    choices = [sorted({name, *indistinguishable_from(name)}) for name in sorted(answer)]
    return [frozenset(choice) for choice in product(*choices)]


def _base(verdict: Verdict, case: Case, strip: StripFile) -> Iterable[Comparison]:
    """Compare the base parameters with the truth, where the plant follows the library's
    laws.
    """
    if not case.alike:
        return
    length, time = (
        case.stiffness * strip.bending_length,
        case.damping * strip.retardation_time,
    )
    for name, true in (("bending_length", length), ("retardation_time", time)):
        if name in verdict.base:
            yield _compare(name, true, 0.0, verdict.base[name])


def _effects(verdict: Verdict, case: Case) -> Iterable[Comparison]:
    """Compare the parameters of rightly named effects with the truth, where the laws
    agree.
    """
    for effect in verdict.effects:
        if case.alike and effect.name in case.effects:
            yield from _compare_effect(effect, case.effects[effect.name])


def _compare_effect(
    effect: NamedEffect, truth: dict[str, float]
) -> Iterable[Comparison]:
    known = registry()[effect.name]
    for i, p in enumerate(known.parameters):
        if p.name in truth and p.name in effect.parameters:
            label, found = f"{effect.name}.{p.name}", effect.parameters[p.name]
            yield _compare(label, truth[p.name], p.start, found, switch=i == 0)


def _compare(
    name: str, truth: float, null: float, found: Interval, *, switch: bool = False
) -> Comparison:
    size = abs(truth - null)
    error = abs(found.value - truth) / size if size else None
    return Comparison(
        name=name,
        truth=truth,
        value=found.value,
        low=found.low,
        high=found.high,
        error=error,
        switch=switch,
    )


def claim_on(verdict: Verdict, case: Case, *, withheld: bool = False) -> Values:
    """What a verdict accepts on `case`, whose effects may be `withheld` from the
    library.
    """
    answer = frozenset(case.answer)
    if verdict.effects:
        held = [result(verdict, case) in RIGHT_RESULTS]
    else:
        right = frozenset[str]().union(*with_twins(answer))
        held = [not right.isdisjoint(group) for group in verdict.ambiguous]
        suspected = frozenset(effect.name for effect in verdict.suspected)
        if suspected:
            held.append(_score_names(suspected, answer) in RIGHT_RESULTS)
    hides = bool(case.effects or case.causes)
    outside = withheld or (hides and not case.answer)
    return claim(verdict, case.name, held, outside=outside, hides=hides)


def claim(
    verdict: Verdict, case: str, held: Sequence[bool], *, outside: bool, hides: bool
) -> Values:
    """What a verdict accepts, for the calibration of confidence: the evidence, None
    where nothing speaks against it, and whether all that it `held` to is right.

    Of a cause that lies `outside` the library nothing is; `hides`: whether there is a
    cause.
    """
    posterior, signs = verdict.posterior, None
    if posterior is not None and posterior.log_odds < math.inf:
        signs = posterior.model_dump(include=set(VerdictEvidence.model_fields))
    right = all(held) and not outside if held else None
    known = {"case": case, "signs": signs, "right": right}
    return {**known, "outside": outside, "hides": hides}
