"""Scores a verdict against the hidden causes, in pure functions, the only ones that see both."""

from collections.abc import Iterable, Sequence
from dataclasses import asdict
from itertools import product
from typing import Literal

from cell.gap.strength import twins
from cell.gap.verdict.confidence import Signs
from cell.gap.verdict.schema import Interval, NamedEffect, Verdict
from cell.gap.verdict.schema import Kind as VerdictKind
from drivers.settings import Settings
from drivers.strip.effects import registry
from drivers.strip.file import StripFile
from tests.lab.exam.case import Case, Kind, Strength, Tier

Result = Literal[
    "right_strict", "right_class", "partly", "wrong_name", "abstained",
    "false_alarm", "gap_claimed", "correct_no_gap", "correct_abstention",
]  # fmt: skip
RIGHT_RESULTS: tuple[Result, ...] = ("right_strict", "right_class")


class Checked(Settings):
    """Comparison of an estimated parameter with its true value.

    `error` is relative to the truth's distance from the null, None where that is zero; `switch`
    where the parameter says how much of an effect there is.
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

    `realised` is the excess gap after the base was refitted, `rival` the strongest model that was
    not accepted, with its nats over the base, `reason` the verdict's text on what remains, `signs`
    what its confidence rests on.
    """

    case: str
    tier: Tier
    kind: Kind
    strength: Strength | None
    hidden: tuple[str, ...]
    answer: tuple[str, ...]
    verdict: VerdictKind
    named: tuple[str, ...]
    classes: tuple[tuple[str, ...], ...]
    result: Result
    confidence: float | None
    realised: float
    shrink: float
    base: tuple[Checked, ...]
    parameters: tuple[Checked, ...]
    rival: str
    reason: str
    runtime: float
    simulations: int
    signs: dict[str, float] | None = None

    @property
    def right(self) -> bool:
        """Whether the hidden effects were named, strictly or by their class."""
        return self.result in RIGHT_RESULTS

    @property
    def claimed(self) -> bool:
        """Whether the verdict claims a gap, with a name or without."""
        return self.verdict != "no_gap"


def score(verdict: Verdict, case: Case, strip: StripFile) -> Outcome:
    """Score a verdict on the runs of `case`, whose strip file is `strip`."""
    named = tuple(effect.name for effect in verdict.effects)
    rival, reason = _rival(verdict, named), verdict.unexplained
    return Outcome(
        case=case.name, tier=case.tier, kind=case.kind, strength=case.strength,
        hidden=hidden_names(case), answer=case.answer,
        verdict=verdict.verdict, named=named, classes=tuple(map(tuple, verdict.ambiguous)),
        result=result(verdict, case),
        confidence=min((e.confidence for e in verdict.effects), default=None),
        realised=verdict.gap.before["excess"], shrink=verdict.gap.shrink,
        base=tuple(_base(verdict, case, strip)), parameters=tuple(_effects(verdict, case)),
        rival=rival, reason=reason.description if reason else "",
        runtime=verdict.runtime, simulations=verdict.simulations, signs=_signs(verdict),
    )  # fmt: skip


def hidden_names(case: Case) -> tuple[str, ...]:
    """Names of all effects and causes hidden in the plant."""
    return tuple(sorted((*case.effects, *case.causes)))


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
    """Result for a cause outside the library: right only if the gap is found but not explained."""
    if verdict.verdict == "unexplained":
        return "correct_abstention"
    return "abstained" if verdict.verdict == "no_gap" else "wrong_name"


def _score_names(named: frozenset[str], answer: frozenset[str]) -> Result:
    """Result of named effects: wrong with a false name, partly right with one of two effects."""
    if named == answer:
        return "right_strict"
    if named in with_twins(answer):
        return "right_class"
    parts = [part for whole in with_twins(answer) for part in whole]
    return "partly" if len(answer) > 1 and named <= set(parts) else "wrong_name"


def _score_classes(classes: Iterable[Sequence[str]], answer: frozenset[str]) -> Result:
    """Result of ambiguous classes: right if they hold the whole answer, partly if one of a pair."""
    held = answer & {name for group in classes for name in group}
    if answer and held == answer:
        return "right_class"
    return "partly" if held else "abstained"


def with_twins(answer: frozenset[str]) -> list[frozenset[str]]:
    """All variants of the answer with effects replaced by their twins, which look alike."""
    choices = [sorted({name, *twins(name)}) for name in sorted(answer)]
    return [frozenset(choice) for choice in product(*choices)]


def same(name: str, answer: Iterable[str]) -> bool:
    """Whether `name` is in the answer; a twin, which looks alike, counts as the name itself."""
    return any(name in whole for whole in with_twins(frozenset(answer)))


def _base(verdict: Verdict, case: Case, strip: StripFile) -> Iterable[Checked]:
    """Compare the base parameters with the truth, where the plant follows the library's laws."""
    if not case.alike:
        return
    length, time = case.stiffness * strip.bending_length, case.damping * strip.retardation_time
    for name, true in (("bending_length", length), ("retardation_time", time)):
        if name in verdict.base:
            yield _compare(name, true, 0.0, verdict.base[name])


def _effects(verdict: Verdict, case: Case) -> Iterable[Checked]:
    """Compare the parameters of rightly named effects with the truth, where the laws agree."""
    for effect in verdict.effects:
        if case.alike and effect.name in case.effects:
            yield from _compare_effect(effect, case.effects[effect.name])


def _compare_effect(effect: NamedEffect, truth: dict[str, float]) -> Iterable[Checked]:
    known = registry()[effect.name]
    for i, p in enumerate(known.parameters):
        if p.name in truth and p.name in effect.parameters:
            label, found = f"{effect.name}.{p.name}", effect.parameters[p.name]
            yield _compare(label, truth[p.name], p.null or 0.0, found, switch=i == 0)


def _compare(
    name: str, truth: float, null: float, found: Interval, *, switch: bool = False
) -> Checked:
    size = abs(truth - null)
    error = abs(found.value - truth) / size if size else None
    return Checked(
        name=name, truth=truth, value=found.value, low=found.low, high=found.high,
        error=error, switch=switch,
    )  # fmt: skip


def _signs(verdict: Verdict) -> dict[str, float] | None:
    if verdict.posterior is None or verdict.posterior.log_odds is None:
        return None
    return asdict(Signs.of(verdict.posterior, verdict.gap))


def _rival(verdict: Verdict, named: tuple[str, ...]) -> str:
    for row in verdict.candidates:
        if frozenset(row.name.split(" + ")) != frozenset(named):
            return f"{row.name} ({row.elpd_gain:.0f} nats)"
    return ""
